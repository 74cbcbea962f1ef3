//! Executions that one pass can serve: of one node type and equal parameters, with equal inputs but for
//! the port that [`Node::SHARES`](lightloom_nodes::node::Node::SHARES) names.

use super::execution::{Place, Plan};
use crate::graph::Graph;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Which executions of a plan share a pass.
pub struct Together {
    /// For each execution: its place in `sets`; none where nothing can be shared.
    of: Vec<Option<usize>>,
    sets: Vec<Vec<usize>>,
}

/// What must be equal.
type Sameness = (
    &'static str,
    Vec<(&'static str, String)>,
    Vec<PathBuf>,
    Vec<(&'static str, Vec<Place>)>,
    usize,
);

impl Together {
    /// Finds the sets by the structure of the graph, before anything runs.
    pub fn new(graph: &Graph, plan: &Plan) -> Self {
        let mut found: BTreeMap<Sameness, Vec<usize>> = BTreeMap::new();
        for (e, execution) in plan.executions.iter().enumerate() {
            let node = &graph.nodes[execution.node];
            let Some(shared) = node.node.shares() else { continue };
            let others = execution.inputs.iter().filter(|(port, _)| *port != shared).cloned();
            let sameness = (
                node.kind,
                node.node.canonical(),
                node.node.reads(),
                others.collect(),
                execution.run,
            );
            found.entry(sameness).or_default().push(e);
        }
        let sets: Vec<Vec<usize>> = found.into_values().filter(|set| set.len() > 1).collect();
        let mut of = vec![None; plan.executions.len()];
        for (number, set) in sets.iter().enumerate() {
            set.iter().for_each(|&e| of[e] = Some(number));
        }
        Together { of, sets }
    }

    /// No sharing at all: every execution runs and is timed by itself.
    pub fn none(plan: &Plan) -> Self {
        Together { of: vec![None; plan.executions.len()], sets: Vec::new() }
    }

    /// The other executions that could share a pass with `e`.
    pub fn with(&self, e: usize) -> impl Iterator<Item = usize> + '_ {
        let set = self.of[e].map_or(&[][..], |set| &self.sets[set]);
        set.iter().copied().filter(move |&other| other != e)
    }
}
