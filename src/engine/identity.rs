//! What an execution is before anything has run: the same text as its manifest, with the identities of
//! its inputs where their contents are not known yet.

use super::bindings::Held;
use super::execution::Plan;
use super::manifest::Manifest;
use crate::graph::Graph;
use crate::store::{Store, StoreError};
use lightloom_nodes::node::Digest;

/// The identity of every execution of a plan. Equal ones must give equal results, in any graph; unequal
/// ones may still turn out to do so once their inputs are known.
///
/// # Errors
/// When a file that a node reads cannot be read.
pub fn identities(graph: &Graph, plan: &Plan, store: &Store) -> Result<Vec<Digest>, StoreError> {
    let mut found = vec![Digest::of(b""); plan.executions.len()];
    let mut by_node: Vec<Vec<usize>> = vec![Vec::new(); graph.nodes.len()];
    for (e, execution) in plan.executions.iter().enumerate() {
        by_node[execution.node].push(e);
    }
    // Nodes stand after their inputs.
    for (node, executions) in graph.nodes.iter().zip(by_node) {
        if executions.is_empty() {
            continue;
        }
        let files = Manifest::files(node, store)?;
        for e in executions {
            let item = |&(n, item): &(usize, usize)| Held {
                digest: item_identity(graph, plan, &found, n, item),
                bytes: 0,
            };
            let execution = &plan.executions[e];
            let inputs: Vec<(&'static str, Vec<Held>)> = execution
                .inputs
                .iter()
                .map(|(port, places)| (*port, places.iter().map(item).collect()))
                .collect();
            found[e] = Manifest::new(node, &files, &inputs).key();
        }
    }
    Ok(found)
}

/// An item of the shot's own sequence is what it is; any other is the execution's and its place there.
fn item_identity(graph: &Graph, plan: &Plan, found: &[Digest], n: usize, item: usize) -> Digest {
    if graph.nodes[n].gives_the_shot() {
        return plan.times[item];
    }
    let giver = plan.giver[n][item];
    let place = item - plan.executions[giver].items.start;
    Digest::of(format!("{} {place}", found[giver]).as_bytes())
}
