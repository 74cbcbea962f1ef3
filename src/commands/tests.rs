//! What the tests of commands share: a graph of nodes that take no time, with a cache of its own.

use super::progress::Silent;
use super::session::{Failure, Session};
use super::{Common, GraphArgs};
use crate::engine::{self, Options, Summary};
use crate::registry::Registry;
use glam::Vec3;
use lightloom_nodes::data::{Image, Time};
use lightloom_nodes::node::{Ctx, Error, Item, Node};
use std::path::PathBuf;
use tempfile::TempDir;

lightloom_nodes::params! {
    /// A square of one grey, brighter the later it is. For tests.
    pub struct Grey {
        /// Radiance at the start.
        level: f32 = 0.5, 0.0..=1.0;
        /// Pixels along each side.
        size: u32 = 4;
        /// What it does with the level.
        round: bool = false;
    }
}

lightloom_nodes::inputs! {
    /// Inputs of [`Grey`].
    pub struct GreyIn {
        /// When; the start without it.
        time: Option<Item<Time>>
    }
}

impl Node for Grey {
    const KIND: &'static str = "Grey";
    const VERSION: u32 = 1;
    type In = GreyIn;
    type Out = Image;

    fn run(&self, input: GreyIn, ctx: &Ctx) -> Result<Image, Error> {
        ctx.note("one grey");
        let level = if self.round { self.level.round() } else { self.level };
        let level = level + input.time.map_or(0.0, |t| t.seconds) as f32;
        let side = self.size as usize;
        Ok(Image::new(side, side, vec![Vec3::splat(level); side * side]))
    }
}

/// Three frames in chunks of two; `still` is for no output.
const GRAPH: &str = r#"Graph(
    vars: { "level": 0.25 },
    nodes: {
        "frames": Frames(last: 2, chunk: 2),
        "grey": Grey(time: "frames", level: "$level"),
        "other": Grey(time: "frames", level: 0.75),
        "png": Png(image: "grey"),
        "compare": Compare(image: "grey", reference: "other"),
        "still": Grey(),
    },
    outputs: { "picture": "png", "errors": "compare" },
)
"#;

/// A folder with a graph and a cache.
pub struct Bench {
    folder: TempDir,
    registry: Registry,
}

impl Bench {
    /// The graph above and an empty cache.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("graph.ron"), GRAPH).unwrap();
        Bench { folder, registry: Registry::builtin().with::<Grey>() }
    }

    pub fn registry(&self) -> &Registry {
        &self.registry
    }

    /// A place in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The graph with changes, and the cache, as a command opens them.
    pub fn session(&self, set: &[&str]) -> Session {
        let common = Common { json: false, cache: self.path("cache"), quota: None };
        let set = set.iter().map(|s| (*s).to_owned()).collect();
        let args = GraphArgs { graph: self.path("graph.ron"), set };
        match Session::open(&common, &args, &self.registry) {
            Ok(session) => session,
            Err(failure) => panic!("{}", told(&failure)),
        }
    }

    /// Runs what the outputs need.
    pub fn run(&self, set: &[&str]) -> Summary {
        self.run_nodes(set, &["png", "compare"])
    }

    /// Runs what the nodes of those names need.
    pub fn run_nodes(&self, set: &[&str], names: &[&str]) -> Summary {
        let session = self.session(set);
        let wanted: Vec<usize> = names.iter().filter_map(|name| session.graph.find(name)).collect();
        let Ok(plan) = session.plan(&wanted) else { panic!("the graph has no plan") };
        let options = Options { jobs: 1, ..Options::default() };
        engine::run(&session.graph, &plan, &wanted, &session.store, &options, &Silent).unwrap().0
    }
}

/// What a command ended with.
pub fn told(failure: &Failure) -> String {
    match failure {
        Failure::Graph(all) => all.iter().map(|d| d.render(false)).collect(),
        Failure::Usage(text) | Failure::Nothing(text) => text.clone(),
        Failure::Points { message, .. } => message.clone(),
        Failure::Engine(error) => error.to_string(),
    }
}
