//! The nearest entry found so far, and what is too far to be nearer.

use super::centres::Centres;
use super::lanes::{Eight, GROUP, Lanes, squared};
use super::principal::Projected;

/// Room for the rounding of two distances: relative, and absolute where squares underflow.
pub const MARGIN: f32 = 1e-5;
/// See [`MARGIN`].
pub const LEAST: f32 = 1e-18;

/// The nearest entry found so far.
pub struct Best<'a> {
    centres: &'a Centres,
    x: &'a [Eight],
    /// The vector's numbers along the axes and off them.
    pub point: Eight,
    slack: f32,
    /// An entry that does not count.
    without: Option<u32>,
    /// The entry.
    pub entry: u32,
    /// Its squared distance.
    pub square: f32,
    /// An entry whose squared distance along the axes is above this one is farther.
    pub most: f32,
}

impl<'a> Best<'a> {
    /// Starts with an entry and its finite squared distance from `x`.
    #[inline(always)]
    pub fn new<L: Lanes>(
        centres: &'a Centres,
        projected: &Projected,
        x: &'a [Eight],
        (entry, square): (u32, f32),
    ) -> Self {
        let point = projected.axes.project::<L>(x);
        let slack = projected.slack(&point, square.sqrt());
        let mut best = Best { centres, x, point, slack, without: None, entry, square, most: 0.0 };
        best.limit();
        best
    }

    /// The same without one of the entries.
    #[inline(always)]
    pub fn other_than<L: Lanes>(
        without: u32,
        centres: &'a Centres,
        projected: &Projected,
        x: &'a [Eight],
        start: (u32, f32),
    ) -> Self {
        Best { without: Some(without), ..Best::new::<L>(centres, projected, x, start) }
    }

    #[inline(always)]
    fn limit(&mut self) {
        let near = self.square.sqrt() * (1.0 + MARGIN) + self.slack;
        self.most = near * near;
    }

    /// Compares with four entries.
    #[inline(always)]
    pub fn compare<L: Lanes>(&mut self, entries: &[u32; GROUP]) {
        let squares = squared::<L>(self.x, entries.map(|c| self.centres.get(c, self.x.len())));
        let [a, b, c, d] = squares;
        if a.min(b).min(c.min(d)) > self.square {
            return;
        }
        for (&entry, &square) in entries.iter().zip(&squares) {
            let nearer = square < self.square || (square == self.square && entry < self.entry);
            if nearer && self.without != Some(entry) {
                (self.entry, self.square) = (entry, square);
            }
        }
        self.limit();
    }
}
