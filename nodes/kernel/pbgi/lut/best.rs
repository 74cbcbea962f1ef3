//! The nearest entry found so far, and what is too far to be nearer.

use super::lanes::{Eight, GROUP, Lanes, squared};
use super::neighbours::{Centres, MARGIN};
use super::principal::Projected;

/// The nearest entry found so far.
pub struct Best<'a> {
    centres: &'a Centres,
    projected: &'a Projected,
    x: &'a [Eight],
    /// The vector's numbers along the axes.
    pub point: Eight,
    slack: f32,
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
        projected: &'a Projected,
        x: &'a [Eight],
        (entry, square): (u32, f32),
    ) -> Self {
        let point = Eight(projected.axes.project::<L>(x).store());
        // The vector is at most so long.
        let slack = projected.slack(square.sqrt());
        let mut best = Best { centres, projected, x, point, slack, entry, square, most: 0.0 };
        best.limit();
        best
    }

    #[inline(always)]
    fn limit(&mut self) {
        let near = self.square.sqrt() * (1.0 + MARGIN) + self.slack;
        self.most = near * near;
    }

    /// Compares with four entries that may be far.
    #[inline(always)]
    pub fn consider<L: Lanes>(&mut self, entries: &[u32; GROUP]) {
        let points = entries.map(|c| std::slice::from_ref(&self.projected.points[c as usize]));
        let [a, b, c, d] = squared::<L>(std::slice::from_ref(&self.point), points);
        if a.min(b).min(c.min(d)) <= self.most {
            self.compare::<L>(entries);
        }
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
            if square < self.square || (square == self.square && entry < self.entry) {
                (self.entry, self.square) = (entry, square);
            }
        }
        self.limit();
    }
}
