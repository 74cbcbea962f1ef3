//! A single run as a document, so that a report needs to know of one kind only.

use super::front::summarize;
use super::gather::{Album, Gather};
use super::work::{Group, Member};
use crate::engine::{EngineError, Plan, Resolution};
use crate::graph::Graph;
use crate::report::{Document, Plot, Point};
use crate::store::Store;
use lightloom_nodes::node::Error;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Endings of pictures that browsers show.
const SHOWN: [&str; 3] = ["png", "apng", "jpg"];

/// A graph as a group of one point that asks for its outputs, and what the cache knows of it.
///
/// # Errors
/// When the node that makes the sequence of frames fails, or a file that a node reads cannot be read.
pub fn whole(graph: Graph, store: &Arc<Store>) -> Result<(Group, Resolution), EngineError> {
    let wanted: Vec<usize> = graph.outputs.iter().map(|(_, node)| *node).collect();
    let plan = Plan::new(&graph, &wanted, store).map_err(|cause| EngineError::Node {
        name: "frames".into(),
        kind: "the shot",
        item: String::new(),
        cause: Error::invalid(cause.to_string()),
    })?;
    let mut known = Resolution::new(&graph, &plan);
    known.settle(&graph, &plan, store)?;
    let of = |figures: bool| {
        graph.outputs.iter().filter(|(_, n)| graph.nodes[*n].figures == figures).cloned().collect()
    };
    let needed = graph.needed(&wanted);
    let nodes = graph.nodes.iter().enumerate().filter(|(n, _)| needed[*n]);
    let member = Member {
        point: 0,
        nodes: nodes.map(|(n, node)| (node.name.clone(), n)).collect(),
        measure: of(true),
        pictures: of(false),
        cost: wanted.clone(),
    };
    let members = vec![member];
    Ok((Group { graph, plan, wanted, identities: Vec::new(), members }, known))
}

/// What the cache knows of the outputs of a graph: numbers become figures, pictures are shown, and all
/// that they need is the cost. `text` is the graph as it was run.
///
/// # Errors
/// Those of [`whole`].
pub fn single(
    graph: Graph,
    store: &Arc<Store>,
    text: String,
    title: &str,
    source: &str,
) -> Result<Document, EngineError> {
    let (group, known) = whole(graph, store)?;
    let host = gethostname::gethostname().to_string_lossy().into_owned();
    let gather = Gather { store, group: &group, known: &known, host: &host };
    let mut album = Album::default();
    let mut point = gather.point(&group.members[0], &mut album);
    point.pictures.retain(|(_, place)| SHOWN.contains(&&*album.pictures[*place].extension));
    let figures: Vec<String> = point.figures.keys().cloned().collect();
    let y = figures.first().cloned().unwrap_or_default();
    let mut document = Document {
        title: title.to_owned(),
        source: source.to_owned(),
        made: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
        version: env!("CARGO_PKG_VERSION").into(),
        figures,
        plot: Plot { x: "evaluations".into(), y, colour: None },
        points: vec![Point { graph: text, ..point }],
        pictures: album.pictures,
        ..Document::default()
    };
    summarize(&mut document, vec![Vec::new()]);
    Ok(document)
}
