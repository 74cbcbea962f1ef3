//! Clustering of the columns of a single frame (Hašan 2007): sampling, divide and conquer, and both.

use super::rectangles::{Settings, cluster_tensor};
use super::{Error, History, Tensor, Tick};

/// Share of the clusters that `Mode::Combined` makes by sampling.
const SAMPLED: f64 = 0.66;

/// How the columns of one frame are clustered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Multi-set sampling alone: fast, but some clusters are too small or too large.
    Sampling,
    /// Splits of the cluster of highest cost, from a single one: slow while clusters are large.
    Divide,
    /// Sampling for two thirds of the clusters, then splits: the paper's choice.
    Combined,
}

/// Clusters the lights of a tensor of one frame into `count` clusters; a split cuts the order on a random line at its best
/// position. The history of `Sampling` and `Combined` starts from the sampled clusters, so that smaller counts are not in it;
/// fewer clusters than `count` come out of `Sampling`, because lights are drawn with replacement, and when fewer lights contribute.
///
/// Fails on a tensor of several frames, on a count of zero, and when `tick` does.
pub fn cluster_columns<E>(
    tensor: &Tensor,
    mode: Mode,
    count: usize,
    seed: u64,
    tick: &Tick<E>,
) -> Result<History, E>
where
    E: From<Error> + Send,
{
    if tensor.frames() != 1 {
        return Err(Error::Frames(tensor.frames()).into());
    }
    let start = match mode {
        Mode::Sampling => count,
        Mode::Divide => 1,
        Mode::Combined => ((SAMPLED * count as f64) as usize).max(1),
    };
    let settings = Settings { start, limit: count, time_weight: 1.0, seed, cuts: &[] };
    cluster_tensor(tensor, &settings, tick)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{no_tick, smooth};
    use super::*;

    #[test]
    fn each_mode_partitions_the_lights() {
        let tensor = smooth(400, 60, 1);
        for (mode, least) in [(Mode::Sampling, 30), (Mode::Divide, 60), (Mode::Combined, 60)] {
            let history = cluster_columns(&tensor, mode, 60, 1, &no_tick).unwrap();
            let clusters = history.cut(60).unwrap();
            assert!((least..=60).contains(&clusters.len()), "{mode:?}: {}", clusters.len());
            let dark = history.dark().unwrap();
            let mut all: Vec<u32> =
                clusters.into_iter().chain(dark).flat_map(|c| c.lights).collect();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..400));
        }
    }

    #[test]
    fn smaller_counts_are_there_for_division_only() {
        let tensor = smooth(400, 60, 1);
        let divided = cluster_columns(&tensor, Mode::Divide, 60, 1, &no_tick).unwrap();
        assert_eq!(divided.cut(7).unwrap().len(), 7);
        let combined = cluster_columns(&tensor, Mode::Combined, 60, 1, &no_tick).unwrap();
        let start = combined.min_count();
        assert!(start > 20 && start <= 39, "{start}");
        assert_eq!(combined.cut(start - 1), Err(Error::Limit { limit: start - 1, start }));
    }

    #[test]
    fn splitting_after_sampling_costs_less_than_sampling() {
        let tensor = smooth(800, 60, 1);
        let cost =
            |mode| cluster_columns(&tensor, mode, 90, 4, &no_tick).unwrap().cost(90).unwrap();
        let (combined, sampling) = (cost(Mode::Combined), cost(Mode::Sampling));
        assert!(combined < sampling, "{combined} {sampling}");
    }

    #[test]
    fn several_frames_and_no_clusters_are_refused() {
        let error = cluster_columns(&smooth(9, 4, 2), Mode::Divide, 3, 1, &no_tick).unwrap_err();
        assert_eq!(error, Error::Frames(2));
        for mode in [Mode::Sampling, Mode::Combined, Mode::Divide] {
            assert!(cluster_columns(&smooth(9, 4, 1), mode, 0, 1, &no_tick).is_err());
        }
    }
}
