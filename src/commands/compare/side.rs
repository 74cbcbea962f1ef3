//! One side of a comparison: its images, and for runs and points what made them.

use crate::commands::session::{Failure, Session, read_text};
use crate::commands::sweep::SweepSession;
use crate::commands::{Common, GraphArgs};
use crate::engine::{Bindings, EngineError, Resolution};
use crate::graph::Graph;
use crate::registry::Registry;
use crate::store::Store;
use crate::sweep::{Group, Member, cost_of, whole};
use lightloom_nodes as nodes;
use nodes::data::{Data, Image, Picture};
use nodes::node::{All, Binder, Ctx, File, Item, Node};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What the making of images took, from the records of the cache.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Cost {
    /// Processor seconds.
    pub cpu_seconds: f64,
    /// Matrix elements evaluated.
    pub evaluations: u64,
}

/// One side of a comparison.
pub struct Side {
    /// How the user named it.
    pub label: String,
    /// Its images in order.
    pub images: All<Image>,
    /// Every parameter of every node it needs, as `node.parameter` and canonical text.
    pub parameters: Vec<(String, String)>,
    /// What it took; none for files.
    pub cost: Option<Cost>,
}

impl Side {
    /// Opens a file, a folder of files, a graph that was run, or a point of a sweep that was run.
    pub fn open(
        text: &str,
        node: Option<&str>,
        common: &Common,
        registry: &Registry,
        store: &Arc<Store>,
    ) -> Result<Side, Failure> {
        let path = Path::new(text);
        if path.is_dir() {
            return Self::of_files(text, frames(path)?);
        }
        let is = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
        if is("exr") || is("hdr") {
            return Self::of_files(text, vec![path.to_owned()]);
        }
        if let Some((file, point)) = text.rsplit_once(':') {
            let session = SweepSession::open(common, Path::new(file), registry)?;
            return Self::of_point(text, file, point, node, session);
        }
        let graph = GraphArgs { graph: path.to_owned(), set: Vec::new() };
        if crate::sweep::is_sweep(&read_text(path)?) {
            return Err(Failure::Usage(format!(
                "{text} is a sweep: name one of its points, as {text}:0"
            )));
        }
        let session = Session::open(common, &graph, registry)?;
        let (group, known) = whole(session.graph, store)?;
        let told = || format!("lightloom run {text}");
        Self::of_graph(text, &group, &group.members[0], &known, node, store, told)
    }

    fn of_files(label: &str, files: Vec<PathBuf>) -> Result<Side, Failure> {
        let read = |file: PathBuf| {
            let image = nodes::ImageFile { file: File(file) }.run((), &Ctx::default());
            image.map(Item::from).map_err(|e| Failure::Usage(e.to_string()))
        };
        let images: Vec<Item<Image>> = files.into_iter().map(read).collect::<Result<_, _>>()?;
        Ok(Side {
            label: label.to_owned(),
            images: All::from(images),
            parameters: Vec::new(),
            cost: None,
        })
    }

    fn of_point(
        label: &str,
        file: &str,
        point: &str,
        node: Option<&str>,
        session: SweepSession,
    ) -> Result<Side, Failure> {
        let count = session.outline.len();
        let number = point.parse::<usize>().ok().filter(|n| *n < count);
        let Some(number) = number else {
            return Err(Failure::Nothing(format!(
                "{file} has no point `{point}`: it has {count}, counted from 0"
            )));
        };
        for (group, known) in session.work.groups.iter().zip(session.resolve()?) {
            if let Some(member) = group.members.iter().find(|m| m.point == number) {
                let label = format!("{label} {}", session.outline.label(number));
                let told = || format!("lightloom sweep {file}");
                return Self::of_graph(&label, group, member, &known, node, &session.store, told);
            }
        }
        Err(Failure::Nothing(format!(
            "point {point} of {file} cannot run: a file it reads is missing"
        )))
    }

    fn of_graph(
        label: &str,
        group: &Group,
        member: &Member,
        known: &Resolution,
        node: Option<&str>,
        store: &Arc<Store>,
        how: impl Fn() -> String,
    ) -> Result<Side, Failure> {
        let find = |name: &str| member.nodes.iter().find(|(n, _)| n == name).map(|(_, at)| *at);
        let at = match node {
            Some(name) => find(name)
                .ok_or_else(|| Failure::Nothing(format!("{label} has no node `{name}`")))?,
            None => image_of(&group.graph, &member.wanted()).ok_or_else(|| {
                Failure::Nothing(format!("{label} makes no image; name its node with --node"))
            })?,
        };
        let gives = group.graph.nodes[at].output;
        if gives != Image::TYPE {
            return Err(Failure::Usage(format!(
                "{} of {label} gives {gives}, no image",
                group.graph.nodes[at].name
            )));
        }
        let missing = || Failure::Nothing(format!("{label} is not in the cache: {}", how()));
        let mut held = Vec::new();
        for item in &known.held[at] {
            let item = item.ok_or_else(missing)?;
            if store.open_blob(&item.digest, item.bytes)?.is_none() {
                return Err(missing());
            }
            held.push(item);
        }
        let bindings = Bindings::new(Arc::clone(store), vec![("image", held)]);
        let images = bindings.bound("image").map_err(|e| Failure::Usage(e.to_string()))?;
        let needed = group.graph.needed(&[at]);
        let parameters = member.nodes.iter().filter(|(_, n)| needed[*n]).flat_map(|(name, n)| {
            let node = &group.graph.nodes[*n].node;
            node.canonical()
                .into_iter()
                .map(move |(parameter, value)| (format!("{name}.{parameter}"), value))
        });
        let cost = cost_of(group, known, store, &[at]);
        Ok(Side {
            label: label.to_owned(),
            images,
            parameters: parameters.collect(),
            cost: cost.map(|(cpu_seconds, evaluations)| Cost { cpu_seconds, evaluations }),
        })
    }

    /// The parameters that differ, each as `rows.bins (5, 5) -> (10, 10)`.
    pub fn changes_to(&self, other: &Side) -> Vec<String> {
        if self.parameters.is_empty() || other.parameters.is_empty() {
            return Vec::new();
        }
        let find = |side: &Side, name: &str| -> Option<String> {
            side.parameters.iter().find(|(n, _)| n == name).map(|(_, value)| value.clone())
        };
        let mut names: Vec<&String> = self.parameters.iter().map(|(name, _)| name).collect();
        names.extend(
            other.parameters.iter().map(|(name, _)| name).filter(|n| find(self, n).is_none()),
        );
        let told = |value: Option<String>| value.unwrap_or_else(|| "none".into());
        names
            .into_iter()
            .map(|name| (name, find(self, name), find(other, name)))
            .filter(|(_, before, after)| before != after)
            .map(|(name, before, after)| format!("{name} {} -> {}", told(before), told(after)))
            .collect()
    }
}

/// The frames in a folder, by name.
fn frames(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let entries = std::fs::read_dir(folder)
        .map_err(|cause| EngineError::Io { path: folder.to_owned(), cause })?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|e| e == "exr" || e == "hdr"));
    files.sort();
    if files.is_empty() {
        return Err(Failure::Nothing(format!("{} holds no .exr or .hdr file", folder.display())));
    }
    Ok(files)
}

/// The image that is wanted first: itself an image, or the nearest one that a wanted picture is made of.
fn image_of(graph: &Graph, wanted: &[usize]) -> Option<usize> {
    let direct = wanted.iter().copied().find(|&n| graph.nodes[n].output == Image::TYPE);
    let picture = wanted.iter().copied().find(|&n| graph.nodes[n].output == Picture::TYPE);
    direct.or_else(|| {
        let mut open = vec![picture?];
        while let Some(n) = open.pop() {
            if graph.nodes[n].output == Image::TYPE {
                return Some(n);
            }
            open.extend(graph.nodes[n].inputs.iter().flat_map(|(_, from)| from));
        }
        None
    })
}
