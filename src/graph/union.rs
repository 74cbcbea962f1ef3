//! Several graphs as one, in which nodes that must give the same exist once.

use super::{Axis, Graph, GraphNode};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Equal parameters, files and inputs.
type Sameness = (
    &'static str,
    Vec<(&'static str, String)>,
    Vec<PathBuf>,
    Vec<(&'static str, Vec<usize>)>,
    (Axis, Axis),
);

/// A growing union of graphs.
pub struct Union {
    graph: Graph,
    places: BTreeMap<Sameness, usize>,
}

impl Default for Union {
    fn default() -> Self {
        let graph = Graph {
            nodes: Vec::new(),
            outputs: Vec::new(),
            vars: Vec::new(),
            warnings: Vec::new(),
        };
        Union { graph, places: BTreeMap::new() }
    }
}

impl Union {
    /// Adds the nodes of `graph` that `needed` marks, and with every node all that it needs. Gives the
    /// place of each in the union. Of equal nodes the first one's name stays.
    pub fn add(&mut self, graph: Graph, needed: &[bool]) -> Vec<Option<usize>> {
        let mut place: Vec<Option<usize>> = Vec::with_capacity(graph.nodes.len());
        for (node, needed) in graph.nodes.into_iter().zip(needed) {
            let at = needed.then(|| self.place(node, &place));
            place.push(at);
        }
        place
    }

    fn place(&mut self, mut node: GraphNode, place: &[Option<usize>]) -> usize {
        for (_, from) in &mut node.inputs {
            // Nodes come after their inputs, all of which are needed with them.
            *from = from.iter().filter_map(|&f| place[f]).collect();
        }
        let sameness = (
            node.kind,
            node.node.canonical(),
            node.node.reads(),
            node.inputs.clone(),
            (node.runs, node.axis),
        );
        *self.places.entry(sameness).or_insert_with(|| {
            self.graph.nodes.push(node);
            self.graph.nodes.len() - 1
        })
    }

    /// The union; it publishes nothing.
    pub fn into_graph(self) -> Graph {
        self.graph
    }
}
