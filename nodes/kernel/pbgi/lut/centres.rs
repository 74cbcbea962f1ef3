//! The entries of a table as vectors side by side.

use super::lanes::{Eight, Lanes, WIDTH, blocked, padded, squared_of_eight, wide};

/// Centres, in both layouts of `lanes`.
pub struct Centres {
    /// Numbers of a centre.
    pub dims: usize,
    /// Number of centres.
    pub count: usize,
    /// Centre by centre.
    pub padded: Vec<Eight>,
    /// By eights.
    pub blocked: Vec<Eight>,
}

impl Centres {
    /// Vectors of `dims` numbers, times `scale`.
    pub fn new(vectors: &[f32], dims: usize, scale: f32) -> Self {
        let padded = padded(vectors, dims, scale);
        let blocked = blocked(&padded, dims.div_ceil(WIDTH), dims);
        Centres { dims, count: vectors.len() / dims, padded, blocked }
    }

    /// One of them.
    #[inline(always)]
    pub fn get(&self, centre: u32, lanes: usize) -> &[Eight] {
        &self.padded[centre as usize * lanes..(centre as usize + 1) * lanes]
    }
}

wide! {
    /// The squared distances of `x` from all of `blocked`, `dims` lanes an eight.
    pub fn squared_from_all(x: &[Eight], dims: usize, blocked: &[Eight], squares: &mut [f32]) = from_all
}

#[inline(always)]
fn from_all<L: Lanes>(x: &[Eight], dims: usize, blocked: &[Eight], squares: &mut [f32]) {
    let (squares, _) = squares.as_chunks_mut::<WIDTH>();
    for (block, squares) in blocked.chunks_exact(dims).zip(squares) {
        *squares = squared_of_eight::<L>(x, block).store();
    }
}
