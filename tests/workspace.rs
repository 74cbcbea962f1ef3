//! What the tests of the engine and of the command line share: project folders with a cache, runs
//! through the library, and toy nodes with known numbers.

mod toys;

pub use toys::{most_at_once, runs_of, tag};

use lightloom::engine::{
    self, EngineError, Held, Options, Plan, Progress, Published, Resolution, Summary,
};
use lightloom::graph::{Graph, Override};
use lightloom::nodes::data::{Data, Time, decode};
use lightloom::registry::Registry;
use lightloom::store::Store;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;
use toys::{Combine, Heavy, Running, Step, Total, Trouble};

/// Overrides that make the shot of `graphs/tensor.ron` a matter of half a second.
pub const SMALL: &[&str] = &[
    "last=3",
    "still=2",
    "size=(48, 27)",
    "lights=300",
    "rows=(4, 3)",
    "columns=40",
    "scene.detail=0.3",
    "sky_lights.count=128",
    "lanterns.count=48",
    "samples.count=240",
    "photons.count=500",
    "clusters.start=20",
    "clusters.limit=60",
];

/// A project folder with a graph file, its cache and its output folder.
pub struct Workspace {
    folder: TempDir,
    root: PathBuf,
    registry: Registry,
}

/// What a run through the library left.
pub struct Ran {
    pub graph: Graph,
    pub plan: Plan,
    pub summary: Summary,
    pub known: Resolution,
    pub store: Arc<Store>,
}

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _: usize, _: &str, _: usize, _: usize) {}
    fn step(&self, _: usize, _: usize, _: u64, _: u64) {}
    fn end(&self, _: usize, _: usize) {}
}

/// Where the graph files of the repository are.
pub fn graphs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("graphs")
}

/// One execution at a time within a gigabyte.
pub fn options() -> Options {
    Options { jobs: 1, memory: 1 << 30, ..Options::default() }
}

impl Workspace {
    /// A project with the graph `text`.
    pub fn new(text: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("project");
        fs::create_dir(&root).unwrap();
        let registry = Registry::builtin()
            .with::<Combine>()
            .with::<Total>()
            .with::<Step>()
            .with::<Running>()
            .with::<Trouble>()
            .with::<Heavy>();
        let workspace = Workspace { folder, root, registry };
        workspace.write("graph.ron", text);
        workspace
    }

    /// A project with a copy of one of the repository's graphs.
    pub fn of(name: &str) -> Self {
        Self::new(&fs::read_to_string(graphs().join(name)).unwrap())
    }

    /// A place in the project.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Writes a file of the project.
    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Edits the graph file; `from` must stand in it.
    pub fn edit(&self, from: &str, to: &str) {
        let text = fs::read_to_string(self.path("graph.ron")).unwrap();
        assert!(text.contains(from), "{from} is not in the graph");
        self.write("graph.ron", &text.replace(from, to));
    }

    /// Moves the project with its cache to another folder.
    pub fn move_to(&mut self, name: &str) {
        let to = self.folder.path().join(name);
        fs::rename(&self.root, &to).unwrap();
        self.root = to;
    }

    /// The cache, opened anew as another process would.
    pub fn store(&self) -> Arc<Store> {
        Arc::new(Store::open(&self.path("cache"), None).unwrap())
    }

    /// The graph with changes.
    pub fn graph(&self, set: &[&str]) -> Graph {
        let text = fs::read_to_string(self.path("graph.ron")).unwrap();
        let set: Vec<Override> = set.iter().map(|s| Override((*s).to_owned())).collect();
        let told = |all: Vec<lightloom::graph::Diagnostic>| {
            all.iter().map(|d| d.render(false)).collect::<String>()
        };
        Graph::read(&text, "graph.ron", &self.root, &self.registry, &set)
            .unwrap_or_else(|all| panic!("{}", told(all)))
    }

    /// Runs what `wanted` needs, or all outputs if it is empty.
    pub fn attempt(
        &self,
        set: &[&str],
        wanted: &[&str],
        options: &Options,
        progress: &dyn Progress,
    ) -> Result<Ran, EngineError> {
        let (graph, store) = (self.graph(set), self.store());
        let mut places: Vec<usize> = wanted.iter().map(|name| graph.find(name).unwrap()).collect();
        if wanted.is_empty() {
            places = graph.outputs.iter().map(|(_, node)| *node).collect();
        }
        let plan = Plan::new(&graph, &places, &store).unwrap();
        let (summary, known) = engine::run(&graph, &plan, &places, &store, options, progress)?;
        Ok(Ran { graph, plan, summary, known, store })
    }

    /// Runs the outputs, one execution at a time.
    pub fn run(&self, set: &[&str]) -> Ran {
        self.attempt(set, &[], &options(), &Silent).unwrap()
    }

    /// Runs `wanted`, one execution at a time.
    pub fn run_nodes(&self, set: &[&str], wanted: &[&str]) -> Result<Ran, EngineError> {
        self.attempt(set, wanted, &options(), &Silent)
    }

    /// Runs the outputs of the small tensor shot with more changes.
    pub fn run_small(&self, set: &[&str]) -> Ran {
        self.run(&[SMALL, set].concat())
    }
}

impl Ran {
    /// Names of the nodes of which anything ran.
    pub fn nodes(&self) -> Vec<&str> {
        self.summary.nodes_that_ran()
    }

    /// How many executions of `node` ran, and of how many.
    pub fn ran(&self, node: &str) -> (usize, usize) {
        let node = self.summary.nodes.iter().find(|n| n.name == node).unwrap();
        (node.ran, node.executions)
    }

    /// The artifacts of `node`.
    pub fn held(&self, node: &str) -> Vec<Held> {
        let items = &self.known.held[self.graph.find(node).unwrap()];
        items.iter().map(|held| held.unwrap()).collect()
    }

    /// Where the blob of an item lies.
    pub fn blob(&self, node: &str, item: usize) -> PathBuf {
        self.store.blob_path(&self.held(node)[item].digest)
    }

    /// An artifact.
    pub fn artifact<T: Data>(&self, node: &str, item: usize) -> T {
        let Held { digest, bytes } = self.held(node)[item];
        let map = self.store.open_blob(&digest, bytes).unwrap().unwrap();
        decode(Arc::new(map.to_vec())).unwrap()
    }

    /// The numbers that the items of a toy node are.
    pub fn numbers(&self, node: &str) -> Vec<f64> {
        (0..self.held(node).len()).map(|k| self.artifact::<Time>(node, k).seconds).collect()
    }

    /// Publishes into `folder`.
    pub fn publish(&self, folder: &Path) -> Vec<Published> {
        engine::publish(&self.graph, &self.plan, &self.known, &self.store, folder).unwrap()
    }
}
