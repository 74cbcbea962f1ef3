//! Reports that the page is tried with, their pictures included.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Rgb, RgbImage};
use lightloom::report::{
    Axis, Cheapest, Document, Encoded, Fate, NodeCost, Plot, Point, Setting, Spread,
};

pub fn png(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Encoded {
    let image = RgbImage::from_fn(width, height, |x, y| Rgb(pixel(x, y)));
    let mut bytes = Vec::new();
    let (fast, none) = (CompressionType::Fast, FilterType::NoFilter);
    image.write_with_encoder(PngEncoder::new_with_quality(&mut bytes, fast, none)).unwrap();
    Encoded { bytes, extension: "png".to_owned() }
}

/// A mixed-up number: noise that is the same each time.
pub fn hash(x: u32, y: u32, seed: u32) -> u32 {
    let mut h =
        x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    for shift in [15, 13, 16] {
        h = (h ^ (h >> shift)).wrapping_mul(0x2C1B_3C6D);
    }
    h >> 24
}

/// A lit ball over a floor, with grain.
fn ball(width: u32, height: u32, grain: f64, seed: u32) -> Encoded {
    png(width, height, |x, y| {
        let (u, v) =
            (f64::from(x) / f64::from(width) - 0.5, f64::from(y) / f64::from(height) - 0.5);
        let (u, r2) = (u * f64::from(width) / f64::from(height), 0.11);
        let floor =
            if v > 0.25 { [0.42, 0.38, 0.33] } else { [0.30 - 0.3 * v, 0.36, 0.45 + 0.2 * v] };
        let height = r2 - u * u - v * v;
        let lit = if height > 0.0 {
            let light = ((-0.5 * u - 0.7 * v + 0.6 * height.sqrt()) / r2.sqrt()).max(0.05);
            [0.95 * light, 0.62 * light, 0.35 * light]
        } else {
            floor
        };
        let noise = grain * (f64::from(hash(x, y, seed)) / 255.0 - 0.5);
        lit.map(|c| ((c + noise).clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8)
    })
}

fn cost(name: &str, kind: &str, seconds: f64, evaluations: u64, counts: bool) -> NodeCost {
    NodeCost {
        name: name.to_owned(),
        kind: kind.to_owned(),
        counts,
        executions: 3,
        seconds,
        cpu_seconds: 1.9 * seconds,
        peak_bytes: 800_000_000 + evaluations,
        bytes: 4 * evaluations + 12_000,
        evaluations,
        together: !counts,
    }
}

/// The graph of a point, with its values and characters that HTML would take for its own.
fn graph(rows: u32, clusters: u32, seed: u32) -> String {
    format!(
        "#![enable(implicit_some)]\nGraph(\n    // </script><b>&amp; not a tag\n    vars: {{ \"rows\": {rows}, \
         \"clusters\": {clusters}, \"seed\": {seed} }},\n    nodes: {{\n        \"rows\": Rows(bins: \"$rows\"),\n    }},\n)\n"
    )
}

pub fn spread(values: &[f64]) -> Option<Spread> {
    let count = values.len();
    let mean = values.iter().sum::<f64>() / count as f64;
    let squares = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    let deviation = if count > 1 { (squares / (count - 1) as f64).sqrt() } else { 0.0 };
    (count > 0).then_some(Spread { mean, deviation, count })
}

/// Four rows times three clusters times two seeds. Both seeds of the last setting failed, and one of
/// the first; the times of two settings are marked.
pub fn sweep() -> Document {
    let (rows, clusters) = ([25, 49, 100, 225], [50, 200, 800]);
    let mut document = Document {
        title: "rows & clusters <pavilion>".to_owned(),
        source: "sweeps/rows.ron".to_owned(),
        made: 1_795_000_000,
        version: "0.1.0".to_owned(),
        axes: vec![
            Axis { name: "rows".to_owned(), values: rows.map(|r| r.to_string()).to_vec() },
            Axis { name: "clusters".to_owned(), values: clusters.map(|c| c.to_string()).to_vec() },
        ],
        seed: Some(Axis { name: "seed".to_owned(), values: vec!["1".to_owned(), "2".to_owned()] }),
        figures: vec!["error.relative".to_owned(), "error.flicker".to_owned()],
        plot: Plot {
            x: "evaluations".to_owned(),
            y: "error.relative".to_owned(),
            colour: Some("rows".to_owned()),
        },
        ..Document::default()
    };
    for (r, c) in rows.iter().flat_map(|r| clusters.map(|c| (*r, c))) {
        let at = document.settings.len();
        let mut setting =
            Setting { values: vec![r.to_string(), c.to_string()], ..Setting::default() };
        for seed in 1..=2 {
            let failed = at == 11 || (at == 0 && seed == 2);
            setting.points.push(document.points.len());
            let mut point = Point {
                setting: at,
                seed: Some(seed.to_string()),
                graph: graph(r, c, seed),
                ..Point::default()
            };
            if failed {
                point.fate = Fate::Failed;
                point.problem = Some("out of memory in \"reps\": needs 27 GB".to_owned());
            } else {
                let wobble = 1.0 + 0.12 * f64::from(hash(r, c, seed)) / 255.0;
                let error = wobble * (0.3 / f64::from(c).sqrt() + 1.2 / f64::from(r));
                point.fate = Fate::Done;
                point.figures = [
                    ("error.relative".to_owned(), error),
                    ("error.flicker".to_owned(), 0.2 * error * wobble),
                ]
                .into();
                let evaluations = u64::from(r) * 576_000 + u64::from(c) * 40_000;
                let seconds = evaluations as f64 / 4.1e6 * wobble;
                point.evaluations = Some(evaluations);
                point.cpu_seconds = Some(1.9 * (seconds + 0.8));
                point.together = at == 4;
                point.other_host = at == 7;
                point.nodes = vec![
                    cost("scene", "Pavilion", 0.8, 0, true),
                    cost("rows", "Rows", 0.2 * seconds, u64::from(r) * 576_000, true),
                    cost("image", "Reconstruct", 0.8 * seconds, u64::from(c) * 40_000, true),
                    cost("error", "Compare", 0.31, 0, false),
                ];
                let picture = document.pictures.len();
                document.pictures.push(ball(160, 90, 2.5 * error, at as u32 * 2 + seed));
                document.pictures.push(png(160, 90, |x, y| {
                    let e = (f64::from(hash(x, y, at as u32)) * 2.5 * error) as u8;
                    [e, e / 3, 40]
                }));
                point.pictures =
                    vec![("picture".to_owned(), picture), ("flip".to_owned(), picture + 1)];
            }
            document.points.push(point);
        }
        document.settings.push(setting);
    }
    gather(&mut document);
    document
}

/// Fills what settings know from their points.
pub fn gather(document: &mut Document) {
    for setting in &mut document.settings {
        let points: Vec<&Point> = setting.points.iter().map(|at| &document.points[*at]).collect();
        for name in &document.figures {
            let values: Vec<f64> =
                points.iter().filter_map(|p| p.figures.get(name).copied()).collect();
            setting.figures.extend(spread(&values).map(|s| (name.clone(), s)));
        }
        let evaluations = points.iter().filter_map(|p| p.evaluations.map(|e| e as f64));
        setting.evaluations = spread(&evaluations.collect::<Vec<_>>());
        setting.cpu_seconds =
            spread(&points.iter().filter_map(|p| p.cpu_seconds).collect::<Vec<_>>());
        setting.together = points.iter().any(|p| p.together);
        setting.other_host = points.iter().any(|p| p.other_host);
    }
    let y = document.plot.y.clone();
    let against = |of: fn(&Setting) -> Option<Spread>, settings: &[Setting]| -> Vec<_> {
        let pair = |s: &Setting| Some((of(s)?.mean, s.figures.get(&y)?.mean));
        settings.iter().map(pair).collect::<Vec<Option<(f64, f64)>>>()
    };
    let costs = [
        against(|s| s.evaluations, &document.settings),
        against(|s| s.cpu_seconds, &document.settings),
    ];
    for (at, setting) in document.settings.iter_mut().enumerate() {
        let [evaluations, cpu_seconds] = costs.each_ref().map(|all| {
            let undercut = |(x, y)| all.iter().flatten().any(|(u, v)| *u <= x && *v < y);
            all[at].is_some_and(|own| !undercut(own))
        });
        (setting.front_evaluations, setting.front_cpu_seconds) = (evaluations, cpu_seconds);
    }
    document.cheapest.extend([0.05, 0.02, 0.01].map(|target| {
        let [evaluations, cpu_seconds] = costs.each_ref().map(|all| {
            let met = all.iter().enumerate().filter_map(|(at, own)| Some((at, (*own)?)));
            let met = met.filter(|(_, (_, y))| *y <= target);
            met.min_by(|(_, (x, _)), (_, (u, _))| x.total_cmp(u)).map(|(at, _)| at)
        });
        Cheapest { target, evaluations, cpu_seconds }
    }));
}

/// One point of no sweep.
pub fn single() -> Document {
    let mut document = sweep();
    document.title = "quick".to_owned();
    document.axes.clear();
    document.seed = None;
    document.cheapest.clear();
    document.points = vec![Point { setting: 0, seed: None, ..document.points.swap_remove(8) }];
    document.settings = vec![Setting { points: vec![0], ..Setting::default() }];
    gather(&mut document);
    document.cheapest.clear();
    document
}
