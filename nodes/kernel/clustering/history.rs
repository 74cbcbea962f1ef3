//! The split history of a clustering, from which every smaller number of clusters is read off.

use super::Error;

/// A rectangular cluster: the Cartesian product of its lights and its frames.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cluster {
    /// Lights, ascending.
    pub lights: Vec<u32>,
    /// First frame.
    pub first_frame: u32,
    /// One past the last frame.
    pub last_frame: u32,
}

/// How a clustering came about: its starting clusters and then one split after the other. Plain arrays, to be stored as they are.
///
/// A cluster owns a range of `lights`. A split leaves the first part in the place (number) of the cluster and appends the
/// second as a new cluster. A split in lights divides the range; a split in time gives the second part a range of its own,
/// the next ones of `lights` after those given out before.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct History {
    /// The ranges of lights of all clusters.
    pub lights: Vec<u32>,
    /// The starting clusters, four numbers each: start in `lights`, number of lights, first frame, one past the last frame.
    pub start: Vec<u32>,
    /// Rectangles without any light on the sampled rows, in the same form: they belong to every clustering and render nothing.
    pub dark: Vec<u32>,
    /// The splits, three numbers each: number of the cluster, 0 for lights or 1 for time, and the position: the number of
    /// lights that stay, or the frame at which the new cluster begins.
    pub splits: Vec<u32>,
    /// Total cost with the starting clusters and after each split.
    pub costs: Vec<f64>,
}

impl History {
    /// The smallest number of clusters that `cut` gives: that of the starting clusters.
    pub fn min_count(&self) -> usize {
        self.start.len() / 4
    }

    /// The largest number of clusters that `cut` gives.
    pub fn max_count(&self) -> usize {
        self.min_count() + self.splits.len() / 3
    }

    /// The clusters after splitting up to `count`, or all there are if they are fewer; the dark rectangles are not among them.
    /// Exactly the clusters of a clustering with that limit. Fails below the number of starting clusters and on a history
    /// that contradicts itself.
    pub fn cut(&self, count: usize) -> Result<Vec<Cluster>, Error> {
        let start = self.min_count();
        if count < start {
            return Err(Error::Limit { limit: count, start });
        }
        let mut extents = self.extents(&self.start)?;
        // Ranges made by splits in time follow those of the start and of the dark rectangles.
        let dark = self.extents(&self.dark)?;
        let mut end = extents.iter().chain(&dark).map(|e| e.end()).max().unwrap_or(0);
        for split in self.splits.as_chunks::<3>().0.iter().take(count - start) {
            let extent = extents
                .get_mut(split[0] as usize)
                .ok_or(Error::Damaged("a split names a cluster that does not exist"))?;
            let second = extent.divide(split[1], split[2], end)?;
            end = end.max(second.end());
            extents.push(second);
        }
        extents.iter().map(|extent| self.cluster(extent)).collect()
    }

    /// The dark rectangles as clusters: at most one in each segment between camera cuts.
    pub fn dark(&self) -> Result<Vec<Cluster>, Error> {
        self.extents(&self.dark)?.iter().map(|extent| self.cluster(extent)).collect()
    }

    /// The total cost of the clusters that `cut(count)` gives; `None` below the number of starting clusters.
    pub fn cost(&self, count: usize) -> Option<f64> {
        let splits = count.min(self.max_count()).checked_sub(self.min_count())?;
        self.costs.get(splits).copied()
    }

    fn extents(&self, numbers: &[u32]) -> Result<Vec<Extent>, Error> {
        let (extents, rest) = numbers.as_chunks::<4>();
        if !rest.is_empty() {
            return Err(Error::Damaged("a cluster is incomplete"));
        }
        Ok(extents
            .iter()
            .map(|&[start, len, first, last]| Extent { start, len, first, last })
            .collect())
    }

    fn cluster(&self, extent: &Extent) -> Result<Cluster, Error> {
        let lights = self.lights.get(extent.start as usize..extent.end() as usize);
        let mut lights =
            lights.ok_or(Error::Damaged("a cluster lies outside the lights"))?.to_vec();
        lights.sort_unstable();
        Ok(Cluster { lights, first_frame: extent.first, last_frame: extent.last })
    }
}

/// A cluster as a range of the lights array and a range of frames.
#[derive(Clone, Copy)]
pub struct Extent {
    pub start: u32,
    pub len: u32,
    pub first: u32,
    pub last: u32,
}

impl Extent {
    pub const LIGHTS: u32 = 0;
    pub const TIME: u32 = 1;

    pub fn end(&self) -> u64 {
        u64::from(self.start) + u64::from(self.len)
    }

    /// Keeps the first part of a split and gives the second, whose lights begin at `end` if the split is in time.
    pub fn divide(&mut self, kind: u32, position: u32, end: u64) -> Result<Extent, Error> {
        let mut second = *self;
        match kind {
            Self::LIGHTS if (1..self.len).contains(&position) => {
                second.start = u32::try_from(u64::from(self.start) + u64::from(position))
                    .map_err(|_| Error::Damaged("a cluster lies outside the lights"))?;
                second.len -= position;
                self.len = position;
            }
            Self::TIME if (self.first + 1..self.last).contains(&position) => {
                second.start = u32::try_from(end)
                    .map_err(|_| Error::Damaged("a cluster lies outside the lights"))?;
                second.first = position;
                self.last = position;
            }
            _ => return Err(Error::Damaged("a split leaves one side empty")),
        }
        Ok(second)
    }

    pub fn numbers(&self) -> [u32; 4] {
        [self.start, self.len, self.first, self.last]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lights 0..3 over four frames: split in time at 2, then the first part in lights, then the second part otherwise.
    fn example() -> History {
        History {
            lights: vec![2, 0, 1, 7, 1, 2, 0],
            start: vec![0, 3, 0, 4],
            dark: vec![3, 1, 0, 4],
            splits: vec![0, 1, 2, 0, 0, 1, 1, 0, 2],
            costs: vec![8.0, 4.0, 2.0, 1.0],
        }
    }

    fn cluster(lights: &[u32], first_frame: u32, last_frame: u32) -> Cluster {
        Cluster { lights: lights.to_vec(), first_frame, last_frame }
    }

    #[test]
    fn each_count_is_read_off() {
        let history = example();
        assert_eq!(history.cut(1).unwrap(), [cluster(&[0, 1, 2], 0, 4)]);
        assert_eq!(history.cut(2).unwrap(), [cluster(&[0, 1, 2], 0, 2), cluster(&[0, 1, 2], 2, 4)]);
        let four = [
            cluster(&[2], 0, 2),
            cluster(&[1, 2], 2, 4),
            cluster(&[0, 1], 0, 2),
            cluster(&[0], 2, 4),
        ];
        assert_eq!(history.cut(4).unwrap(), four);
        assert_eq!(history.cut(9).unwrap(), four);
        assert_eq!(history.dark().unwrap(), [cluster(&[7], 0, 4)]);
        assert_eq!(
            (history.cost(0), history.cost(1), history.cost(3)),
            (None, Some(8.0), Some(2.0))
        );
        assert_eq!(history.cost(9), Some(1.0));
        assert_eq!(history.cut(0), Err(Error::Limit { limit: 0, start: 1 }));
    }

    #[test]
    fn damage_is_an_error() {
        for (split, value) in [(0, 5), (1, 9), (2, 0), (2, 4), (5, 3)] {
            let mut history = example();
            history.splits[split] = value;
            assert!(matches!(history.cut(4), Err(Error::Damaged(_))), "{split} {value}");
        }
        let mut short = example();
        short.lights.truncate(5);
        assert!(matches!(short.cut(2), Err(Error::Damaged(_))));
        let mut far = example();
        far.start[0] = u32::MAX;
        assert!(matches!(far.cut(1), Err(Error::Damaged(_))));
    }
}
