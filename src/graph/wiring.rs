//! What holds between nodes: names on ports, types, order, sequences, outputs.

use super::axes::{Axes, Axis, Bound, Fault, infer};
use super::diagnostic::{Code, Diagnostic};
use super::file::nearest_node;
use super::nodes::{Draft, Link, Made};
use super::tree::{Field, Shape};
use crate::registry::Registry;
use lightloom_nodes::node::{Cardinality, PortSpec};
use petgraph::Direction;
use petgraph::graph::{DiGraph, NodeIndex};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// The nodes of a file and how they hang together.
pub struct Wiring<'a, 'r> {
    drafts: &'a [Draft<'r>],
    registry: &'r Registry,
    index: BTreeMap<&'a str, usize>,
}

/// A link whose node exists.
struct Edge<'a, 'r> {
    port: &'r PortSpec,
    link: &'a Link,
    from: usize,
}

impl<'a, 'r> Wiring<'a, 'r> {
    /// Of these nodes.
    pub fn new(drafts: &'a [Draft<'r>], registry: &'r Registry) -> Self {
        let mut index = BTreeMap::new();
        for (i, draft) in drafts.iter().enumerate() {
            index.entry(&*draft.name).or_insert(i);
        }
        Wiring { drafts, registry, index }
    }

    /// The node called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.index.get(name).copied()
    }

    fn edges(&self, node: usize) -> Vec<Edge<'a, 'r>> {
        let Some(made) = &self.drafts[node].made else { return Vec::new() };
        let links = made
            .inputs
            .iter()
            .flat_map(|(port, links)| links.iter().map(move |link| (*port, link)));
        links
            .filter_map(|(port, link)| Some(Edge { port, link, from: self.find(&link.name)? }))
            .collect()
    }

    fn names(&self) -> impl Iterator<Item = &'a str> + Clone {
        self.drafts.iter().map(|d| &*d.name)
    }

    /// Reports names on ports that are no nodes, and nodes that give something else than the port takes.
    pub fn check_links(&self, mistakes: &mut Vec<Diagnostic>) {
        for draft in self.drafts {
            let Some(made) = &draft.made else { continue };
            for (port, link) in
                made.inputs.iter().flat_map(|(port, links)| links.iter().map(move |l| (port, l)))
            {
                let Some(from) = self.find(&link.name) else {
                    let help = nearest_node(&link.name, self.names().filter(|n| *n != draft.name));
                    let help = help.or_else(|| self.givers(port.data, draft));
                    let message = format!("there is no node {:?}", link.name);
                    mistakes
                        .push(Diagnostic::new(Code::Node, link.span.clone(), message).help(help));
                    continue;
                };
                let Some(source) = &self.drafts[from].made else { continue };
                if source.kind.output != port.data {
                    let (wants, gives) = (port.data, source.kind.output);
                    let message =
                        format!("`{}` takes {wants}, but {:?} gives {gives}", port.name, link.name);
                    let mistake = Diagnostic::new(Code::Type, link.span.clone(), message)
                        .label(format!("this is {gives}"))
                        .related(source.place.clone(), format!("gives {gives}"))
                        .help(self.givers(wants, draft));
                    mistakes.push(mistake);
                }
            }
        }
    }

    /// The nodes that would fit a port, or the kinds of which one could be made.
    fn givers(&self, data: &str, but: &Draft<'_>) -> Option<String> {
        let others = self.drafts.iter().filter(|d| d.name != but.name);
        let fits = |d: &&Draft<'_>| d.made.as_ref().is_some_and(|m| m.kind.output == data);
        let nodes: Vec<String> =
            others.filter(fits).take(12).map(|d| format!("{:?}", d.name)).collect();
        if !nodes.is_empty() {
            return Some(format!("nodes that give {data}: {}", nodes.join(", ")));
        }
        let kinds: Vec<&str> =
            self.registry.types().iter().filter(|t| t.output == data).map(|t| t.kind).collect();
        (!kinds.is_empty())
            .then(|| format!("kinds of nodes that give {data}: {}", kinds.join(", ")))
    }

    /// All nodes, each after its inputs, otherwise in the order of the file. Nodes that need themselves
    /// are reported and left out, with all that need them.
    pub fn order(&self, mistakes: &mut Vec<Diagnostic>) -> Vec<usize> {
        let mut graph = DiGraph::<(), ()>::new();
        let places: Vec<NodeIndex> = self.drafts.iter().map(|_| graph.add_node(())).collect();
        for node in 0..places.len() {
            for edge in self.edges(node) {
                graph.add_edge(places[edge.from], places[node], ());
            }
        }
        let inputs =
            |&node: &NodeIndex| graph.neighbors_directed(node, Direction::Incoming).count();
        let mut waits: Vec<usize> = places.iter().map(inputs).collect();
        // A plain topological sort would do, but of what is ready the first in the file comes first.
        let mut ready: BinaryHeap<Reverse<usize>> =
            waits.iter().enumerate().filter(|(_, w)| **w == 0).map(|(i, _)| Reverse(i)).collect();
        let mut order = Vec::with_capacity(self.drafts.len());
        while let Some(Reverse(node)) = ready.pop() {
            order.push(node);
            for next in graph.neighbors(places[node]).map(NodeIndex::index) {
                waits[next] -= 1;
                if waits[next] == 0 {
                    ready.push(Reverse(next));
                }
            }
        }
        self.report_cycles(&waits, mistakes);
        order
    }

    /// Walks from each node that still waits to one that it waits for, until a node comes again.
    fn report_cycles(&self, waits: &[usize], mistakes: &mut Vec<Diagnostic>) {
        const FRESH: usize = usize::MAX;
        let mut walk_of = vec![FRESH; waits.len()];
        for start in (0..waits.len()).filter(|&n| waits[n] > 0) {
            let mut path: Vec<Edge<'a, 'r>> = Vec::new();
            let mut trail = Vec::new();
            let mut node = start;
            while walk_of[node] == FRESH {
                walk_of[node] = start;
                trail.push(node);
                let Some(edge) = self.edges(node).into_iter().find(|e| waits[e.from] > 0) else {
                    break;
                };
                node = edge.from;
                path.push(edge);
            }
            let Some(at) = trail.iter().position(|&n| n == node && path.len() == trail.len())
            else {
                continue;
            };
            mistakes.push(self.cycle(&trail[at..], &path[at..]));
        }
    }

    /// A cycle as found: `nodes[k]` needs `edges[k].from`. It is told from its first node in the file.
    fn cycle(&self, nodes: &[usize], edges: &[Edge<'a, 'r>]) -> Diagnostic {
        const TOLD: usize = 8;
        let first = (0..nodes.len()).min_by_key(|&k| nodes[k]).unwrap_or(0);
        let turned = |k: usize| (first + k) % nodes.len();
        let name = |k: usize| &self.drafts[nodes[turned(k)]].name;
        let mut names: Vec<String> =
            (0..nodes.len().min(TOLD)).map(|k| format!("{:?}", name(k))).collect();
        if nodes.len() > TOLD {
            names.push("...".into());
        }
        names.push(format!("{:?}", name(0)));
        let message = format!("nodes need each other in a loop: {}", names.join(" needs "));
        let need = |k: usize| format!("{:?} needs {:?}", name(k), edges[turned(k)].link.name);
        let mut mistake =
            Diagnostic::new(Code::Cycle, edges[first].link.span.clone(), message).label(need(0));
        for k in 1..nodes.len().min(TOLD) {
            mistake = mistake.related(edges[turned(k)].link.span.clone(), need(k));
        }
        mistake
    }

    /// The axes of all nodes in `order`; none for those whose inputs are mistaken.
    pub fn axes(&self, order: &[usize], mistakes: &mut Vec<Diagnostic>) -> Vec<Option<Axes>> {
        let mut all: Vec<Option<Axes>> = vec![None; self.drafts.len()];
        for &node in order {
            let Some(made) = &self.drafts[node].made else { continue };
            let edges = self.edges(node);
            let named = made.inputs.iter().map(|(_, links)| links.len()).sum::<usize>();
            let bound: Vec<Bound> = edges
                .iter()
                .filter_map(|e| {
                    Some(Bound { cardinality: e.port.cardinality, axis: all[e.from]?.axis })
                })
                .collect();
            if bound.len() < named || !made.sound {
                continue;
            }
            let takes_all = made
                .kind
                .ports
                .iter()
                .any(|p| matches!(p.cardinality, Cardinality::All | Cardinality::OptionalAll));
            match infer(made.kind.sequence, takes_all, &bound) {
                Ok(axes) => all[node] = Some(axes),
                Err(fault) => mistakes.push(self.fault(made, fault, &edges, &bound)),
            }
        }
        let mut starts = (0..all.len()).filter(|&n| all[n].is_some_and(Axes::starts_sequence));
        if let Some(first) =
            starts.next().and_then(|n| self.drafts[n].made.as_ref().map(|m| (n, m)))
        {
            for (other, made) in starts.filter_map(|n| Some((n, self.drafts[n].made.as_ref()?))) {
                let names = (&self.drafts[first.0].name, &self.drafts[other].name);
                let message = format!(
                    "a graph has one sequence, but {:?} and {:?} each start one",
                    names.0, names.1
                );
                let mistake = Diagnostic::new(Code::Axis, made.place.clone(), message)
                    .label("starts a second one")
                    .related(first.1.place.clone(), "starts the sequence");
                mistakes.push(mistake);
            }
        }
        all
    }

    fn fault(
        &self,
        made: &Made<'_>,
        fault: Fault,
        edges: &[Edge<'_, '_>],
        bound: &[Bound],
    ) -> Diagnostic {
        let kind = made.kind.kind;
        let port = |i: usize| edges[i].port.name;
        let gives = |i: usize| format!("{:?} gives {}", edges[i].link.name, bound[i].axis.told());
        let at = |i: usize| edges[i].link.span.clone();
        let new =
            |i: usize, message: String| Diagnostic::new(Code::Axis, at(i), message).label(gives(i));
        match fault {
            Fault::Mixed(a, b) => {
                let runs = |i: usize| match bound[i].cardinality {
                    Cardinality::Window => Axis::Pairs.word(),
                    _ => bound[i].axis.word(),
                };
                let message = format!(
                    "`{kind}` cannot run over {} (`{}`) and {} (`{}`) at once",
                    runs(a),
                    port(a),
                    runs(b),
                    port(b)
                );
                new(b, message).related(at(a), gives(a))
            }
            Fault::BesideAll(all, i) => {
                let message = format!(
                    "`{}` takes a whole sequence, so `{kind}` runs once a chunk and `{}` must be one item a chunk",
                    port(all),
                    port(i)
                );
                let help = format!(
                    "for `{}`, use a node that gives a single item or one item a chunk",
                    port(i)
                );
                new(i, message).related(at(all), gives(all)).help(help)
            }
            Fault::NoFrames(i) => {
                let message =
                    format!("`{}` needs a sequence: it takes a frame and the next one", port(i));
                new(i, message).help("use a node that gives one item a frame".to_owned())
            }
            Fault::WholeOfChunks(i) => {
                let message = format!(
                    "`{}` takes the whole sequence of a chunk, and a chunk has one item here",
                    port(i)
                );
                new(i, message).help("use a node that gives one item a frame".to_owned())
            }
            Fault::SequenceOfSequences(i) => {
                new(i, format!("`{kind}` gives a sequence and cannot run once for each of another"))
            }
        }
    }

    /// The published names with their nodes.
    pub fn outputs(
        &self,
        fields: &[Field],
        mistakes: &mut Vec<Diagnostic>,
    ) -> Vec<(String, usize)> {
        let mut outputs = Vec::with_capacity(fields.len());
        for field in fields {
            let span = || field.value.span.clone();
            let Shape::Text(name) = &field.value.shape else {
                if !matches!(field.value.shape, Shape::Broken) {
                    let message = "an output is the name of a node";
                    let help = matches!(field.value.shape, Shape::Word)
                        .then(|| format!("write \"{}\"", field.value.span.text()));
                    mistakes.push(Diagnostic::new(Code::Shape, span(), message).help(help));
                }
                continue;
            };
            let Some(node) = self.find(name) else {
                let help = nearest_node(name, self.names());
                mistakes.push(
                    Diagnostic::new(Code::Node, span(), format!("there is no node {name:?}"))
                        .help(help),
                );
                continue;
            };
            if let Some(made) = &self.drafts[node].made
                && !made.kind.published()
            {
                let gives = made.kind.output;
                let fits: Vec<String> = self
                    .drafts
                    .iter()
                    .filter(|d| d.made.as_ref().is_some_and(|m| m.kind.published()))
                    .map(|d| format!("{:?}", d.name))
                    .collect();
                let help = if fits.is_empty() {
                    "add a node that makes a picture of it".to_owned()
                } else {
                    format!("nodes that can be published: {}", fits.join(", "))
                };
                let message = format!(
                    "{name:?} gives {gives}, which is not published: only pictures and figures are"
                );
                let mistake = Diagnostic::new(Code::Output, span(), message)
                    .related(made.place.clone(), format!("gives {gives}"))
                    .help(help);
                mistakes.push(mistake);
                continue;
            }
            outputs.push((field.name.clone(), node));
        }
        outputs
    }
}
