//! Which cluster is split next, and the total cost after each split.

use std::cmp::Ordering;

/// A cluster that may be split: by cost, then weight, then the older first.
pub struct Candidate {
    pub cost: f64,
    pub weight: f64,
    pub node: u64,
    /// Its place among the clusters.
    pub at: usize,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Candidate) -> Ordering {
        let by_cost = self.cost.total_cmp(&other.cost);
        by_cost.then(self.weight.total_cmp(&other.weight)).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Candidate) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Candidate) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Candidate {}

/// A sum whose terms change: a tree of pairwise sums, because taking a large term off a running total would leave its rounding
/// in place of the small ones.
#[derive(Default)]
pub struct Total {
    /// Levels from the terms up to their sum.
    levels: Vec<Vec<f64>>,
}

impl Total {
    /// Sets a term; a new one must be the next.
    pub fn set(&mut self, mut at: usize, mut term: f64) {
        for level in 0.. {
            if level == self.levels.len() {
                self.levels.push(Vec::new());
            }
            let terms = &mut self.levels[level];
            if terms.len() <= at {
                terms.resize(at + 1, 0.0);
            }
            terms[at] = term;
            if terms.len() == 1 {
                break;
            }
            term = terms[at & !1] + terms.get(at | 1).copied().unwrap_or(0.0);
            at /= 2;
        }
    }

    /// The sum.
    pub fn get(&self) -> f64 {
        self.levels.last().map_or(0.0, |level| level[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_do_not_keep_the_rounding_of_a_large_term() {
        let mut total = Total::default();
        assert_eq!(total.get(), 0.0);
        for at in 0..13 {
            total.set(at, [1e30, 1e-3][at.min(1)]);
        }
        total.set(0, 2e-3);
        assert!((total.get() - 0.014).abs() < 1e-17);
    }
}
