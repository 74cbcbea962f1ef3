//! Judgements of the eye by models of it.

use super::Array;
use crate::artifact;

artifact! {
    /// How different images look from their references when flipping between them.
    pub struct Flip: Figures {
        /// `[frame]` mean FLIP error, 0 (none) to 1.
        flip: Array<f64>,
    }
}

artifact! {
    /// How good an image or a shot looks beside its reference.
    pub struct ColorVideoVdp: Figures {
        /// Quality in units of just objectionable differences: 10 where none is visible; at 9 three of
        /// four viewers prefer the reference.
        jod: f64,
    }
}
