//! Graph files: reading, checking, editing and drawing them.
//!
//! A graph file is RON: `vars` are knobs, `nodes` are the graph, `outputs` are what is published. A node's
//! fields are its parameters and its ports; a port takes the name of a node, or a list of names.
//!
//! ```ron
//! Graph(
//!     vars: { "size": (640, 360) },
//!     nodes: {
//!         "frames": Frames(first: 0, last: 39, fps: 20),
//!         "framebuffer": DeepFramebuffer(geometry: "geometry", camera: "camera", size: "$size"),
//!     },
//!     outputs: { "frame": "exr" },
//! )
//! ```

mod axes;
pub(crate) mod diagnostic;
mod draw;
mod edit;
mod file;
mod nodes;
mod set;
pub(crate) mod syntax;
#[cfg(test)]
mod tests;
mod tokens;
pub(crate) mod tree;
mod union;
mod wiring;

pub use axes::Axis;
pub use diagnostic::{Code, Diagnostic, Source, Span};
pub use draw::{dot, mermaid};
pub use edit::{set_value, set_variable};
pub use set::Override;
pub use union::Union;

use crate::registry::{AnyNode, Registry};
use file::{Sections, Variables, nearest_node};
use lightloom_nodes::node::Cardinality;
use nodes::Draft;
use set::Setting;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use wiring::Wiring;

/// The form of a graph file, for messages.
const GRAPH_FORM: &str = "a graph file is `Graph(vars: {...}, nodes: {...}, outputs: {...})`";

/// A graph without mistakes.
pub struct Graph {
    /// All nodes, each after its inputs, otherwise in the order of the file.
    pub nodes: Vec<GraphNode>,
    /// Published names with their nodes' places in [`Graph::nodes`].
    pub outputs: Vec<(String, usize)>,
    /// The variables with the values in use, in the order of the file.
    pub vars: Vec<Given>,
    /// What is odd but does no harm, by position.
    pub warnings: Vec<Diagnostic>,
}

/// A value as it was given, for explaining.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Given {
    /// The parameter or variable.
    pub name: String,
    /// Its RON text.
    pub text: String,
    /// Where it stands; in `vars` if the parameter names a variable.
    pub span: Span,
}

/// A node of a graph.
pub struct GraphNode {
    /// Its name in the file.
    pub name: String,
    /// Its type's name.
    pub kind: &'static str,
    /// Its type's version.
    pub version: u32,
    /// Type of the artifact it gives.
    pub output: &'static str,
    /// Whether that is nothing but numbers for people.
    pub figures: bool,
    /// The node with its parameters, files resolved against the file's folder.
    pub node: Box<dyn AnyNode>,
    /// The ports that are bound, in the order of the type, with the places of their nodes in [`Graph::nodes`].
    pub inputs: Vec<(&'static str, Vec<usize>)>,
    /// How many artifacts each of those ports takes.
    pub cardinality: Vec<Cardinality>,
    /// One run for each of these.
    pub runs: Axis,
    /// One item of its output for each of these.
    pub axis: Axis,
    /// The parameters that the file or a `--set` gives; all others are at their defaults.
    pub given: Vec<Given>,
    /// Where its name stands in the file.
    pub span: Span,
}

impl GraphNode {
    /// Whether the sequence that the whole shot follows comes from it.
    pub fn gives_the_shot(&self) -> bool {
        self.runs == Axis::Single && self.axis == Axis::Frames
    }
}

impl Graph {
    /// Reads a graph file. `path` is its name in messages; relative files in it start at `folder`;
    /// `overrides` replace values of the file, later ones those of earlier ones.
    ///
    /// # Errors
    /// All mistakes and warnings, in the order of the text, those of `overrides` last.
    pub fn read(
        text: &str,
        path: &str,
        folder: &Path,
        registry: &Registry,
        overrides: &[Override],
    ) -> Result<Graph, Vec<Diagnostic>> {
        let source = Arc::new(Source { path: path.into(), text: text.into() });
        let mut mistakes = Vec::new();
        let graph = read(&source, folder, registry, overrides, &mut mistakes);
        let text_of = |m: &Diagnostic| {
            if Arc::ptr_eq(&m.span.source, &source) {
                return 0;
            }
            overrides.iter().position(|o| o.0 == m.span.source.text).map_or(0, |k| k + 1)
        };
        mistakes.sort_by_cached_key(|m| (text_of(m), m.span.range.start, m.code));
        match graph {
            Some(mut graph) if mistakes.iter().all(|m| m.warning) => {
                graph.warnings = mistakes;
                Ok(graph)
            }
            _ => Err(mistakes),
        }
    }

    /// The place of the node called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|n| n.name == name)
    }

    /// Which nodes the nodes at `wanted` need, themselves included. Others do not run.
    pub fn needed(&self, wanted: &[usize]) -> Vec<bool> {
        let mut needed = vec![false; self.nodes.len()];
        for &node in wanted {
            if let Some(needed) = needed.get_mut(node) {
                *needed = true;
            }
        }
        for (k, node) in self.nodes.iter().enumerate().rev() {
            if needed[k] {
                node.inputs.iter().flat_map(|(_, from)| from).for_each(|&from| needed[from] = true);
            }
        }
        needed
    }
}

fn read(
    source: &Arc<Source>,
    folder: &Path,
    registry: &Registry,
    overrides: &[Override],
    mistakes: &mut Vec<Diagnostic>,
) -> Option<Graph> {
    let mut settings: Vec<Setting> = Vec::with_capacity(overrides.len());
    for given in overrides {
        match given.read() {
            Ok(setting) => settings.push(setting),
            Err(wrong) => mistakes.extend(wrong),
        }
    }
    if source.text.trim().is_empty() {
        let span = Span { source: Arc::clone(source), range: 0..0 };
        mistakes.push(
            Diagnostic::new(Code::Empty, span, "the file is empty").help(GRAPH_FORM.to_owned()),
        );
        return None;
    }
    let parsed = syntax::parse(source, 0);
    mistakes.extend(parsed.mistakes);
    let sections = Sections::of(source, parsed.value?, mistakes);
    let vars = Variables::new(sections.vars, &settings, mistakes);
    let mut by_node: BTreeMap<&str, Vec<&Setting>> = BTreeMap::new();
    for setting in &settings {
        let Some(node) = &setting.node else { continue };
        if !sections.nodes.iter().any(|f| f.name == node.text()) {
            let help = nearest_node(node.text(), sections.nodes.iter().map(|f| &*f.name));
            let message = format!("there is no node {:?}", node.text());
            mistakes.push(Diagnostic::new(Code::Set, node.clone(), message).help(help));
        }
        by_node.entry(node.text()).or_default().push(setting);
    }
    let drafts: Vec<Draft<'_>> = sections
        .nodes
        .iter()
        .map(|field| {
            let settings = by_node.get(&*field.name).map_or(&[][..], |s| s);
            nodes::draft(field, settings, registry, &vars, mistakes)
        })
        .collect();
    let wiring = Wiring::new(&drafts, registry);
    wiring.check_links(mistakes);
    let order = wiring.order(mistakes);
    let axes = wiring.axes(&order, mistakes);
    let outputs = wiring.outputs(&sections.outputs, mistakes);
    vars.unused(mistakes);
    if mistakes.iter().any(|m| !m.warning) {
        return None;
    }
    let mut place = vec![0; drafts.len()];
    for (k, &node) in order.iter().enumerate() {
        place[node] = k;
    }
    type Linked = ((&'static str, Vec<usize>), Cardinality);
    let linked: Vec<Vec<Linked>> = drafts
        .iter()
        .map(|draft| {
            let bound =
                draft.made.iter().flat_map(|m| &m.inputs).filter(|(_, links)| !links.is_empty());
            let find = |links: &[nodes::Link]| {
                links.iter().filter_map(|l| wiring.find(&l.name)).map(|n| place[n]).collect()
            };
            bound.map(|(port, links)| ((port.name, find(links)), port.cardinality)).collect()
        })
        .collect();
    let mut nodes: Vec<(usize, GraphNode)> = Vec::with_capacity(drafts.len());
    for ((k, draft), inputs) in drafts.into_iter().enumerate().zip(linked) {
        let (made, axes) = (draft.made?, axes[k]?);
        let (kind, mut node) = (made.kind, made.node);
        node.resolve(folder);
        let (inputs, cardinality) = inputs.into_iter().unzip();
        let node = GraphNode {
            name: draft.name,
            kind: kind.kind,
            version: kind.version,
            output: kind.output,
            figures: kind.figures,
            node,
            inputs,
            cardinality,
            runs: axes.runs,
            axis: axes.axis,
            given: made.given,
            span: draft.key,
        };
        nodes.push((place[k], node));
    }
    nodes.sort_by_key(|(place, _)| *place);
    let outputs = outputs.into_iter().map(|(name, node)| (name, place[node])).collect();
    let nodes = nodes.into_iter().map(|(_, node)| node).collect();
    Some(Graph { nodes, outputs, vars: vars.given(), warnings: Vec::new() })
}
