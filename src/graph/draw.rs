//! Drawings of a graph, for Graphviz and for Mermaid.

use super::{Axis, Graph, GraphNode};
use std::fmt::Write as _;

/// The graph in DOT: names and kinds on the nodes, ports and what flows on the edges; sequences are thick.
pub fn dot(graph: &Graph) -> String {
    let mut out =
        String::from("digraph {\n    rankdir=LR; node [shape=box, fontname=\"sans-serif\"];\n");
    for (k, node) in graph.nodes.iter().enumerate() {
        let _ = writeln!(out, "    n{k} [label=\"{}\\n{}{}\"];", node.name, node.kind, over(node));
    }
    for (k, node) in graph.nodes.iter().enumerate() {
        for (port, from) in edges(node) {
            let axis = graph.nodes[from].axis;
            let width = if axis == Axis::Single { 1 } else { 3 };
            let _ = writeln!(out, "    n{from} -> n{k} [label=\"{port}\", penwidth={width}];");
        }
    }
    for (k, (name, node)) in graph.outputs.iter().enumerate() {
        let _ = writeln!(out, "    o{k} [label=\"{name}\", shape=note]; n{node} -> o{k};");
    }
    out + "}\n"
}

/// The graph as a Mermaid flow chart; sequences are thick.
pub fn mermaid(graph: &Graph) -> String {
    let mut out = String::from("flowchart LR\n");
    for (k, node) in graph.nodes.iter().enumerate() {
        let _ = writeln!(out, "    n{k}[\"{}<br/>{}{}\"]", node.name, node.kind, over(node));
    }
    for (k, node) in graph.nodes.iter().enumerate() {
        for (port, from) in edges(node) {
            let arrow = if graph.nodes[from].axis == Axis::Single { "-->" } else { "==>" };
            let _ = writeln!(out, "    n{from} {arrow}|{port}| n{k}");
        }
    }
    for (k, (name, node)) in graph.outputs.iter().enumerate() {
        let _ = writeln!(out, "    o{k}([\"{name}\"])\n    n{node} --> o{k}");
    }
    out
}

fn edges(node: &GraphNode) -> impl Iterator<Item = (&'static str, usize)> + '_ {
    node.inputs.iter().flat_map(|(port, from)| from.iter().map(move |&from| (*port, from)))
}

/// What a node runs over and gives, where it is not once for the graph.
fn over(node: &GraphNode) -> String {
    match (node.runs, node.axis) {
        (Axis::Single, Axis::Single) => String::new(),
        (runs, axis) if runs == axis => format!(" [{}]", axis.word()),
        (runs, axis) => format!(" [{} to {}]", runs.word(), axis.word()),
    }
}
