//! Values of the published tools for the five pairs, made by `published_flip.py`.

/// Mean FLIP error by flip-evaluator 1.7 at its own 67 pixels per degree: LDR-FLIP of linear radiance
/// cut at 0 and 1, and HDR-FLIP.
pub const FLIP: [(&str, [f64; 2]); 5] = [
    ("blur", [0.1394699, 0.2964119]),
    ("dark", [0.1704522, 0.1499170]),
    ("hdr", [0.0352137, 0.0923531]),
    ("noise", [0.1168599, 0.0692010]),
    ("shift", [0.2601122, 0.2216707]),
];

/// JOD by cvvdp 0.5.7 (with torch 2.15.0): images on `standard_4k`, `standard_fhd` and
/// `standard_hdr_linear`; then, on `standard_4k`, six frames at 20 Hz of which every other one is
/// the test and the others are the reference.
pub const JOD: [(&str, [f64; 3], f64); 5] = [
    ("blur", [9.231125, 7.588145, 9.076790], 9.809116),
    ("dark", [6.635502, 6.851705, 6.481240], 7.798119),
    ("hdr", [8.412985, 7.639297, 7.679252], 8.869370),
    ("noise", [8.853848, 7.337739, 8.552761], 9.704670),
    ("shift", [8.339325, 8.045183, 8.356522], 9.208279),
];
