//! What commands share: reading a graph, opening the cache, and failing well.

use super::output::say_json;
use super::{Common, GraphArgs};
use crate::engine::{EngineError, Plan, Resolution};
use crate::graph::{Diagnostic, Graph, Override};
use crate::registry::Registry;
use crate::store::{Store, StoreError};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Why a command ended badly, with its exit code.
pub enum Failure {
    /// The graph file or the command line is wrong: 2.
    Graph(Vec<Diagnostic>),
    /// Something else the user gave is wrong: 2.
    Usage(String),
    /// Nothing matched what was asked for: 3.
    Nothing(String),
    /// Points of a sweep failed; the others are there: 1.
    Points {
        /// How many.
        message: String,
        /// What `--json` prints.
        document: serde_json::Value,
    },
    /// A node, the cache or the output folder failed, or the user stopped the run: 1 or 4.
    Engine(EngineError),
}

impl From<EngineError> for Failure {
    fn from(error: EngineError) -> Self {
        Failure::Engine(error)
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        Failure::Engine(error.into())
    }
}

impl Failure {
    fn code(&self) -> u8 {
        match self {
            Failure::Engine(EngineError::Cancelled) => 4,
            Failure::Engine(_) | Failure::Points { .. } => 1,
            Failure::Graph(_) | Failure::Usage(_) => 2,
            Failure::Nothing(_) => 3,
        }
    }

    /// Tells the user, on the error stream or as JSON, and gives the exit code.
    pub fn report(&self, json: bool) -> ExitCode {
        let messages: Vec<serde_json::Value> = match self {
            Failure::Graph(all) => all.iter().map(diagnostic_json).collect(),
            Failure::Points { document, .. } if json => {
                // The failure itself is what counts, even where its report cannot be written.
                let _ = say_json(document);
                return ExitCode::from(self.code());
            }
            Failure::Usage(text)
            | Failure::Nothing(text)
            | Failure::Points { message: text, .. } => {
                vec![serde_json::json!({ "message": text })]
            }
            Failure::Engine(error) => vec![serde_json::json!({ "message": error.to_string() })],
        };
        if json {
            let document =
                serde_json::json!({ "ok": false, "exit_code": self.code(), "errors": messages });
            // The failure itself is what counts, even where its report cannot be written.
            let _ = say_json(&document);
            return ExitCode::from(self.code());
        }
        match self {
            Failure::Graph(all) => print_diagnostics(all),
            _ => messages
                .iter()
                .for_each(|m| eprintln!("error: {}", m["message"].as_str().unwrap_or_default())),
        }
        ExitCode::from(self.code())
    }
}

/// Prints diagnostics as the compiler of this language would.
pub fn print_diagnostics(all: &[Diagnostic]) {
    let color = std::io::stderr().is_terminal();
    all.iter().for_each(|d| eprintln!("{}\n", d.render(color)));
    let errors = all.iter().filter(|d| !d.warning).count();
    if errors > 0 {
        eprintln!("{errors} mistake{}, nothing was run", if errors == 1 { "" } else { "s" });
    }
}

fn diagnostic_json(d: &Diagnostic) -> serde_json::Value {
    let (line, column) = d.span.line_column();
    serde_json::json!({
        "file": d.file(), "line": line, "column": column, "code": d.id(), "warning": d.warning,
        "message": d.message, "help": d.help,
    })
}

/// A graph that was read, and its plan.
pub struct Session {
    /// The graph.
    pub graph: Graph,
    /// The graph's file.
    pub path: PathBuf,
    /// The cache.
    pub store: Arc<Store>,
}

impl Session {
    /// Reads a graph file.
    pub fn graph(args: &GraphArgs, registry: &Registry) -> Result<Graph, Failure> {
        let path = &args.graph;
        let text = read_text(path)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let overrides: Vec<Override> = args.set.iter().cloned().map(Override).collect();
        let label = path.display().to_string();
        Graph::read(&text, &label, folder, registry, &overrides).map_err(Failure::Graph)
    }

    /// Reads a graph file and opens the cache.
    pub fn open(
        common: &Common,
        args: &GraphArgs,
        registry: &Registry,
    ) -> Result<Session, Failure> {
        let graph = Self::graph(args, registry)?;
        print_diagnostics(&graph.warnings);
        Ok(Session { graph, path: args.graph.clone(), store: store(common)? })
    }

    /// The executions that the nodes at `wanted` need.
    pub fn plan(&self, wanted: &[usize]) -> Result<Plan, Failure> {
        Plan::new(&self.graph, wanted, &self.store).map_err(|e| Failure::Usage(e.to_string()))
    }

    /// Those executions, and what the cache knows of them without running any.
    pub fn resolve(&self, wanted: &[usize]) -> Result<(Plan, Resolution), Failure> {
        let plan = self.plan(wanted)?;
        let mut known = Resolution::new(&self.graph, &plan);
        known.settle(&self.graph, &plan, &self.store)?;
        Ok((plan, known))
    }

    /// The nodes whose results are published.
    pub fn outputs(&self) -> Vec<usize> {
        self.graph.outputs.iter().map(|(_, node)| *node).collect()
    }

    /// The node called `name`, or a failure that lists the nearest.
    pub fn node(&self, name: &str) -> Result<usize, Failure> {
        self.graph.find(name).ok_or_else(|| {
            let names = self.graph.nodes.iter().map(|n| n.name.as_str());
            let nearest =
                names.max_by(|a, b| strsim::jaro(a, name).total_cmp(&strsim::jaro(b, name)));
            let hint = nearest.map(|n| format!("; did you mean `{n}`?")).unwrap_or_default();
            Failure::Nothing(format!("the graph has no node `{name}`{hint}"))
        })
    }
}

/// Opens the cache.
pub fn store(common: &Common) -> Result<Arc<Store>, Failure> {
    store_within(common, None)
}

/// Opens the cache; a quota of the command line counts before `gigabytes`.
pub fn store_within(common: &Common, gigabytes: Option<f64>) -> Result<Arc<Store>, Failure> {
    let quota = common.quota.or(gigabytes);
    if let Some(wrong) = quota.filter(|quota| !(quota.is_finite() && *quota >= 0.0)) {
        return Err(Failure::Usage(format!("--quota: expected gigabytes, found {wrong}")));
    }
    Ok(Arc::new(Store::open(&common.cache, quota.map(|quota| (quota * 1e9) as u64))?))
}

/// Reads a file that the user named.
pub fn read_text(path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path)
        .map_err(|e| Failure::Usage(format!("{}: cannot be read: {e}", path.display())))
}
