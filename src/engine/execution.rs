//! From a graph to executions: which node runs how often, on which items, giving which.

use super::Bindings;
use crate::graph::{Axis, Graph};
use crate::store::Store;
use lightloom_nodes::data::write_arrays;
use lightloom_nodes::node::{Cardinality, Ctx, Digest, Error};
use std::ops::Range;
use std::sync::Arc;

/// An item of a node's output: node, place.
pub type Place = (usize, usize);

/// How many frames the shot has, and how they fall into chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shot {
    /// Frames in all; 1 for a still.
    pub frames: usize,
    /// Frames in a chunk; the last may have fewer.
    pub chunk: usize,
}

impl Shot {
    /// Number of items along an axis.
    pub fn len(self, axis: Axis) -> usize {
        match axis {
            Axis::Single => 1,
            Axis::Frames => self.frames,
            Axis::Chunks => self.frames.div_ceil(self.chunk),
            Axis::Pairs => self.frames - self.len(Axis::Chunks),
        }
    }

    /// Frames of a chunk.
    fn frames_of(self, chunk: usize) -> Range<usize> {
        chunk * self.chunk..((chunk + 1) * self.chunk).min(self.frames)
    }

    /// Pairs of a chunk: every chunk but the last has one fewer than frames.
    fn pairs_of(self, chunk: usize) -> Range<usize> {
        let frames = self.frames_of(chunk);
        frames.start - chunk..frames.end - chunk - 1
    }

    /// The chunk in which a run of a node lies.
    fn chunk_of(self, runs: Axis, run: usize) -> usize {
        match runs {
            Axis::Frames => run / self.chunk,
            Axis::Pairs => self.frame_of_pair(run) / self.chunk,
            Axis::Chunks | Axis::Single => run,
        }
    }

    /// First frame of a pair.
    fn frame_of_pair(self, pair: usize) -> usize {
        pair + pair / (self.chunk - 1).max(1)
    }
}

/// One run of one node.
#[derive(Clone, Debug)]
pub struct Execution {
    /// Place of the node in the graph.
    pub node: usize,
    /// Which of the node's runs.
    pub run: usize,
    /// The items bound to each port, in order.
    pub inputs: Vec<(&'static str, Vec<Place>)>,
    /// The items of the node's output that it gives.
    pub items: Range<usize>,
    /// Last frame it looks at: executions that share frames stand together in the schedule.
    pub frame: usize,
}

/// All executions that the wanted nodes need.
pub struct Plan {
    /// The shot.
    pub shot: Shot,
    /// In the order of the schedule: by frame, then in the order of the graph.
    pub executions: Vec<Execution>,
    /// For each node and item, the execution that gives it.
    pub giver: Vec<Vec<usize>>,
    /// Digest of each item of the sequence that the shot is made of; empty for a still.
    pub times: Vec<Digest>,
}

impl Plan {
    /// Expands the nodes that `wanted` need.
    ///
    /// # Errors
    /// When the node that makes the sequence fails.
    pub fn new(graph: &Graph, wanted: &[usize], store: &Arc<Store>) -> Result<Plan, Error> {
        let needed = graph.needed(wanted);
        let (shot, times) = shot(graph, store)?;
        let mut executions = Vec::new();
        for (n, node) in graph.nodes.iter().enumerate().filter(|(n, _)| needed[*n]) {
            for run in 0..shot.len(node.runs) {
                let bound =
                    |((port, from), cardinality): (&(&'static str, Vec<usize>), &Cardinality)| {
                        let places = from
                            .iter()
                            .flat_map(|&f| bind(shot, graph, *cardinality, f, node.runs, run));
                        (*port, places.collect())
                    };
                let inputs = node.inputs.iter().zip(&node.cardinality).map(bound).collect();
                let items = match (node.runs, node.axis) {
                    (Axis::Chunks, Axis::Frames) => shot.frames_of(run),
                    (Axis::Single, Axis::Frames) => 0..shot.frames,
                    _ => run..run + 1,
                };
                executions.push(Execution {
                    node: n,
                    run,
                    inputs,
                    items,
                    frame: last_frame(shot, node.runs, run),
                });
            }
        }
        executions.sort_by_key(|e| (e.frame, e.node, e.run));
        let mut giver: Vec<Vec<usize>> =
            graph.nodes.iter().map(|n| vec![usize::MAX; shot.len(n.axis)]).collect();
        for (e, execution) in executions.iter().enumerate() {
            execution.items.clone().for_each(|item| giver[execution.node][item] = e);
        }
        Ok(Plan { shot, executions, giver, times })
    }
}

/// The length of the shot: that of the sequence its one source gives, or a still; and its items.
fn shot(graph: &Graph, store: &Arc<Store>) -> Result<(Shot, Vec<Digest>), Error> {
    let source = graph.nodes.iter().find(|n| n.gives_the_shot());
    let Some(source) = source else { return Ok((Shot { frames: 1, chunk: 1 }, Vec::new())) };
    let mut times = Vec::new();
    let nothing = Bindings::new(Arc::clone(store), Vec::new());
    let chunk = source.node.run(&[(&nothing, &Ctx::default())], &mut |_, arrays| {
        let mut bytes = Vec::new();
        write_arrays(&mut bytes, arrays).map_err(|e| Error::invalid(e.to_string()))?;
        times.push(Digest::of(&bytes));
        Ok(())
    })?;
    let frames = times.len();
    if frames == 0 {
        return Err(Error::invalid(format!("{} gives a sequence without items", source.name)));
    }
    Ok((Shot { frames, chunk: chunk.clamp(1, frames) }, times))
}

/// The items of node `from` that a port sees in one run.
fn bind(
    shot: Shot,
    graph: &Graph,
    cardinality: Cardinality,
    from: usize,
    runs: Axis,
    run: usize,
) -> Vec<Place> {
    let axis = graph.nodes[from].axis;
    let items: Range<usize> = match (cardinality, axis) {
        (_, Axis::Single) => 0..1,
        (Cardinality::All | Cardinality::OptionalAll, Axis::Frames) => shot.frames_of(run),
        (Cardinality::All | Cardinality::OptionalAll, Axis::Pairs) => shot.pairs_of(run),
        (Cardinality::Window, _) => {
            let first = shot.frame_of_pair(run);
            first..first + 2
        }
        (_, Axis::Chunks) => {
            let chunk = shot.chunk_of(runs, run);
            chunk..chunk + 1
        }
        _ => run..run + 1,
    };
    debug_assert!(
        axis == Axis::Single || axis == runs || runs != Axis::Single,
        "the graph's axes fit"
    );
    items.map(|item| (from, item)).collect()
}

fn last_frame(shot: Shot, runs: Axis, run: usize) -> usize {
    match runs {
        Axis::Single => 0,
        Axis::Frames => run,
        Axis::Pairs => shot.frame_of_pair(run) + 1,
        Axis::Chunks => shot.frames_of(run).end - 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_and_pairs_of_a_shot() {
        let shot = Shot { frames: 10, chunk: 4 };
        assert_eq!((shot.len(Axis::Chunks), shot.len(Axis::Pairs)), (3, 7));
        assert_eq!([0, 1, 2].map(|c| shot.frames_of(c)), [0..4, 4..8, 8..10]);
        assert_eq!([0, 1, 2].map(|c| shot.pairs_of(c)), [0..3, 3..6, 6..7]);
        let first: Vec<usize> = (0..7).map(|p| shot.frame_of_pair(p)).collect();
        assert_eq!(first, [0, 1, 2, 4, 5, 6, 8]);
        let chunks = |runs| (0..shot.len(runs)).map(|run| shot.chunk_of(runs, run)).collect();
        let of_frames: Vec<usize> = chunks(Axis::Frames);
        let of_pairs: Vec<usize> = chunks(Axis::Pairs);
        assert_eq!(of_frames, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2]);
        assert_eq!((of_pairs, chunks(Axis::Chunks)), (vec![0, 0, 0, 1, 1, 1, 2], vec![0, 1, 2]));
    }

    #[test]
    fn chunks_of_one_frame_have_no_pairs() {
        let shot = Shot { frames: 3, chunk: 1 };
        assert_eq!((shot.len(Axis::Chunks), shot.len(Axis::Pairs)), (3, 0));
        assert_eq!(shot.pairs_of(2), 0..0);
    }
}
