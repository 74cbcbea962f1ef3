//! The split history between its kernel and its artifact.

use super::clustering::{self, Cluster, History};
use crate::data::Clusters;
use crate::node::Error;

impl From<clustering::Error> for Error {
    fn from(error: clustering::Error) -> Self {
        Error::invalid(error.to_string())
    }
}

/// The artifact of a history over `lights` lights and `frames` frames.
pub fn store(history: History, lights: usize, frames: usize) -> Clusters {
    let rows = |flat: &[u32]| flat.as_chunks::<4>().0.to_vec().into();
    Clusters {
        member: history.lights.into(),
        start: rows(&history.start),
        dark: rows(&history.dark),
        split: history.splits.as_chunks::<3>().0.to_vec().into(),
        cost: history.costs.into(),
        lights: lights as u32,
        frames: frames as u32,
    }
}

/// One history of many single-frame ones: their splits in turn, so that a cut at a multiple of the
/// number of frames takes equally many of each.
pub fn interleave(frames: &[History]) -> History {
    let mut all = History::default();
    // For each frame, the numbers its clusters have in the whole.
    let mut number: Vec<Vec<u32>> = Vec::new();
    let mut clusters = 0;
    for (k, frame) in frames.iter().enumerate() {
        let offset = all.lights.len() as u32;
        let place = |&[start, len, _, _]: &[u32; 4]| [start + offset, len, k as u32, k as u32 + 1];
        all.start.extend(frame.start.as_chunks::<4>().0.iter().flat_map(place));
        all.dark.extend(frame.dark.as_chunks::<4>().0.iter().flat_map(place));
        all.lights.extend(&frame.lights);
        let starts = frame.min_count() as u32;
        number.push((clusters..clusters + starts).collect());
        clusters += starts;
    }
    let mut cost: Vec<f64> =
        frames.iter().map(|f| f.costs.first().copied().unwrap_or(0.0)).collect();
    all.costs.push(cost.iter().sum());
    let most = frames.iter().map(|f| f.splits.len() / 3).max().unwrap_or(0);
    for turn in 0..most {
        for (k, frame) in frames.iter().enumerate() {
            let Some([cluster, kind, position]) = frame.splits.as_chunks::<3>().0.get(turn) else {
                continue;
            };
            all.splits.extend([number[k][*cluster as usize], *kind, *position]);
            number[k].push(clusters);
            clusters += 1;
            cost[k] = frame.costs[turn + 1];
            all.costs.push(cost.iter().sum());
        }
    }
    all
}

/// The clusters after splitting up to `count`, at least those the history starts from.
///
/// # Errors
/// On a history that contradicts itself.
pub fn cut(clusters: &Clusters, count: usize) -> Result<Vec<Cluster>, Error> {
    let history = History {
        lights: clusters.member.to_vec(),
        start: clusters.start.as_flattened().to_vec(),
        dark: clusters.dark.as_flattened().to_vec(),
        splits: clusters.split.as_flattened().to_vec(),
        costs: clusters.cost.to_vec(),
    };
    Ok(history.cut(count.max(history.min_count()))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::clustering::{Mode, Tensor, cluster_columns};

    fn frame(seed: u64) -> History {
        let value = |i: u64| (i.wrapping_mul(2_654_435_761).wrapping_add(seed * 97) % 1000) as f32;
        let rows: Vec<f32> = (0..60 * 8).map(value).collect();
        let tensor = Tensor::from_frames(60, 8, 1, |_| Ok::<_, Error>(&rows)).unwrap();
        cluster_columns::<Error>(&tensor, Mode::Divide, 12, seed, &|_, _| Ok(())).unwrap()
    }

    #[test]
    fn a_cut_takes_equally_many_clusters_of_each_frame() {
        let frames = [frame(1), frame(2), frame(3)];
        let all = store(interleave(&frames), 60, 3);
        for count in [4, 12] {
            let clusters = cut(&all, 3 * count).unwrap();
            for (k, frame) in frames.iter().enumerate() {
                let mut of_frame: Vec<&Cluster> =
                    clusters.iter().filter(|c| c.first_frame == k as u32).collect();
                let mut alone = frame.cut(count).unwrap();
                assert_eq!(of_frame.len(), count);
                of_frame.sort();
                alone.sort();
                assert!(
                    of_frame
                        .iter()
                        .zip(&alone)
                        .all(|(a, b)| a.lights == b.lights && a.last_frame == k as u32 + 1)
                );
            }
        }
        let sum: f64 = frames.iter().map(|f| f.costs[11]).sum();
        assert!((all.cost[all.cost.len() - 1] - sum).abs() <= 1e-9 * sum);
    }
}
