//! What the tests of the engine and of the command line share: project folders with a cache, runs
//! through the library, and toy nodes with known numbers.

use lightloom::engine::{
    self, EngineError, Held, Options, Plan, Progress, Published, Resolution, Summary,
};
use lightloom::graph::{Graph, Override};
use lightloom::nodes::data::{Data, Time, decode};
use lightloom::nodes::node::{All, Ctx, Error, Item, Node, Sequence, Sizes, Window};
use lightloom::registry::Registry;
use lightloom::store::Store;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use tempfile::TempDir;

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

/// A name for the counters of one test, so that tests side by side do not count each other's runs.
pub fn tag() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

#[derive(Default)]
struct Counts {
    /// Runs by tag.
    runs: BTreeMap<u64, usize>,
    /// Heavy runs under way by tag, and the most there were at a time.
    heavy: BTreeMap<u64, (usize, usize)>,
}

static COUNTS: Mutex<Counts> = Mutex::new(Counts { runs: BTreeMap::new(), heavy: BTreeMap::new() });
static CHANGED: Condvar = Condvar::new();

fn counts() -> MutexGuard<'static, Counts> {
    COUNTS.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// How often nodes of this tag ran.
pub fn runs_of(tag: u64) -> usize {
    counts().runs.get(&tag).copied().unwrap_or(0)
}

/// The most nodes of this tag that ran at a time.
pub fn most_at_once(tag: u64) -> usize {
    counts().heavy.get(&tag).map_or(0, |(_, most)| *most)
}

lightloom_nodes::params! {
    /// a * b + plus, counted.
    pub struct Combine {
        /// Added.
        plus: f64 = 0.0;
        /// Under which its runs are counted.
        tag: u64 = 0;
        /// Milliseconds it takes.
        takes: u64 = 0;
    }
}

lightloom_nodes::inputs! {
    /// Inputs of [`Combine`].
    pub struct CombineIn {
        /// A factor; 1 without it.
        a: Option<Item<Time>>,
        /// Another.
        b: Option<Item<Time>>,
    }
}

impl Node for Combine {
    const KIND: &'static str = "Combine";
    const VERSION: u32 = 1;
    type In = CombineIn;
    type Out = Time;

    fn run(&self, input: CombineIn, _: &Ctx) -> Result<Time, Error> {
        *counts().runs.entry(self.tag).or_default() += 1;
        std::thread::sleep(Duration::from_millis(self.takes));
        let factor = |of: &Option<Item<Time>>| of.as_ref().map_or(1.0, |t| t.seconds);
        Ok(Time { seconds: factor(&input.a) * factor(&input.b) + self.plus })
    }
}

lightloom_nodes::params! {
    /// The sum of a chunk.
    pub struct Total {}
}

lightloom_nodes::inputs! {
    /// Inputs of [`Total`] and [`Running`].
    pub struct WholeIn {
        /// Numbers.
        items: All<Time>,
    }
}

fn numbers(items: &All<Time>) -> Result<Vec<f64>, Error> {
    (0..items.len()).map(|k| items.get(k).map(|t| t.seconds)).collect()
}

impl Node for Total {
    const KIND: &'static str = "Total";
    const VERSION: u32 = 1;
    type In = WholeIn;
    type Out = Time;

    fn run(&self, input: WholeIn, _: &Ctx) -> Result<Time, Error> {
        Ok(Time { seconds: numbers(&input.items)?.iter().sum() })
    }
}

lightloom_nodes::params! {
    /// The running sums of a chunk.
    pub struct Running {
        /// Sums that are missing at the end.
        missing: u32 = 0;
        /// Under which its runs are counted.
        tag: u64 = 0;
    }
}

impl Node for Running {
    const KIND: &'static str = "Running";
    const VERSION: u32 = 1;
    type In = WholeIn;
    type Out = Sequence<Time>;

    fn run(&self, input: WholeIn, _: &Ctx) -> Result<Sequence<Time>, Error> {
        *counts().runs.entry(self.tag).or_default() += 1;
        let mut sum = 0.0;
        let add = |number: f64| {
            sum += number;
            Time { seconds: sum }
        };
        let mut items: Vec<Time> = numbers(&input.items)?.into_iter().map(add).collect();
        items.truncate(items.len().saturating_sub(self.missing as usize));
        Ok(Sequence { items, chunk: 1 })
    }
}

lightloom_nodes::params! {
    /// From a number to the next.
    pub struct Step {}
}

lightloom_nodes::inputs! {
    /// Inputs of [`Step`].
    pub struct StepIn {
        /// Numbers.
        items: Window<Time>,
    }
}

impl Node for Step {
    const KIND: &'static str = "Step";
    const VERSION: u32 = 1;
    type In = StepIn;
    type Out = Time;

    fn run(&self, input: StepIn, _: &Ctx) -> Result<Time, Error> {
        Ok(Time { seconds: input.items.next.seconds - input.items.this.seconds })
    }
}

lightloom_nodes::choice! {
    /// What goes wrong.
    pub enum Wrong {
        /// An error.
        Error = "error",
        /// A panic.
        Panic = "panic",
        /// It does not end before it is cancelled.
        Endless = "endless",
    }
}

lightloom_nodes::params! {
    /// Passes a number on, or does not.
    pub struct Trouble {
        /// The number at which it goes wrong.
        at: f64 = -1.0;
        /// How.
        how: Wrong = Wrong::Error;
    }
}

lightloom_nodes::inputs! {
    /// Inputs of [`Trouble`].
    pub struct TroubleIn {
        /// A number.
        a: Item<Time>,
    }
}

impl Node for Trouble {
    const KIND: &'static str = "Trouble";
    const VERSION: u32 = 1;
    type In = TroubleIn;
    type Out = Time;

    fn run(&self, input: TroubleIn, ctx: &Ctx) -> Result<Time, Error> {
        let seconds = input.a.seconds;
        match self.how {
            _ if seconds != self.at => Ok(Time { seconds }),
            Wrong::Error => Err(Error::invalid(format!("{seconds} is what I was afraid of"))),
            Wrong::Panic => panic!("{seconds} is a bug"),
            Wrong::Endless => loop {
                ctx.tick(0, 1)?;
                std::thread::sleep(Duration::from_millis(1));
            },
        }
    }
}

lightloom_nodes::params! {
    /// Passes a number on, and says that it needs much memory.
    pub struct Heavy {
        /// Bytes.
        bytes: u64 = 0;
        /// Milliseconds for which it waits for another one of its tag.
        waits: u64 = 0;
        /// Under which its runs are counted.
        tag: u64 = 0;
    }
}

impl Node for Heavy {
    const KIND: &'static str = "Heavy";
    const VERSION: u32 = 1;
    type In = TroubleIn;
    type Out = Time;

    fn memory(&self, _: &Sizes) -> u64 {
        self.bytes
    }

    fn run(&self, input: TroubleIn, _: &Ctx) -> Result<Time, Error> {
        let end = Instant::now() + Duration::from_millis(self.waits);
        let mut counts = counts();
        let (now, most) = counts.heavy.entry(self.tag).or_default();
        *now += 1;
        *most = (*most).max(*now);
        CHANGED.notify_all();
        while counts.heavy[&self.tag].1 < 2 {
            let Some(left) = end.checked_duration_since(Instant::now()).filter(|d| !d.is_zero())
            else {
                break;
            };
            counts = CHANGED
                .wait_timeout(counts, left)
                .unwrap_or_else(|poisoned| poisoned.into_inner())
                .0;
        }
        if let Some((now, _)) = counts.heavy.get_mut(&self.tag) {
            *now -= 1;
        }
        Ok(Time { seconds: input.a.seconds })
    }
}
