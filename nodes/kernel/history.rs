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
