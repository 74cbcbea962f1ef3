//! The catalogue of node types, and the one place where their Rust types are erased.

use crate::Bindings;
use lightloom_nodes::data::{Data, Picture, View};
use lightloom_nodes::node::{
    Ctx, Error, Inputs, Node, Output, ParamSpec, PortSpec, Problems, Sizes,
};
use std::path::{Path, PathBuf};

/// Takes the arrays of one item that a node gives, with the place of the run that gave it.
pub type Keep<'a> = dyn FnMut(usize, &[(&str, View<'_>)]) -> Result<(), Error> + 'a;

/// A node whose type is known only by name: the value holds its parameters.
pub trait AnyNode: Send + Sync {
    /// Sets one parameter from its RON text.
    ///
    /// # Errors
    /// What was found and what was expected.
    fn set(&mut self, name: &str, ron: &str) -> Result<(), String>;
    /// Reports parameters that do not fit together.
    fn check(&self, problems: &mut Problems);
    /// Every parameter in canonical text, files left out.
    fn canonical(&self) -> Vec<(&'static str, String)>;
    /// Every file whose content decides the output.
    fn reads(&self) -> Vec<PathBuf>;
    /// Makes relative file paths start at `folder`.
    fn resolve(&mut self, folder: &Path);
    /// Peak bytes of a run.
    fn memory(&self, inputs: &Sizes) -> u64;
    /// The port at which several runs may differ and still share most of their work.
    fn shares(&self) -> Option<&'static str>;
    /// Runs it once, or several times in one pass, and gives the arrays of each item through `keep`,
    /// and the length of a chunk.
    ///
    /// # Errors
    /// Those of the node, and those of `keep`.
    fn run(&self, runs: &[(&Bindings, &Ctx)], keep: &mut Keep<'_>) -> Result<usize, Error>;
}

impl<N: Node> AnyNode for N {
    fn set(&mut self, name: &str, ron: &str) -> Result<(), String> {
        N::set(self, name, ron)
    }
    fn check(&self, problems: &mut Problems) {
        N::check(self, problems);
    }
    fn canonical(&self) -> Vec<(&'static str, String)> {
        N::canonical(self)
    }
    fn reads(&self) -> Vec<PathBuf> {
        N::reads(self)
    }
    fn resolve(&mut self, folder: &Path) {
        N::resolve(self, folder);
    }
    fn memory(&self, inputs: &Sizes) -> u64 {
        N::memory(self, inputs)
    }
    fn shares(&self) -> Option<&'static str> {
        N::SHARES
    }
    fn run(&self, runs: &[(&Bindings, &Ctx)], keep: &mut Keep<'_>) -> Result<usize, Error> {
        let mut bound = Vec::with_capacity(runs.len());
        for (bindings, ctx) in runs {
            bound.push((N::In::bind(*bindings)?, *ctx));
        }
        let outputs = match bound.pop() {
            Some((input, ctx)) if bound.is_empty() => vec![N::run(self, input, ctx)?],
            last => N::run_together(self, bound.into_iter().chain(last).collect())?,
        };
        let mut length = 1;
        for (run, output) in outputs.into_iter().enumerate() {
            let (items, chunk) = output.into_items();
            items.iter().try_for_each(|item| keep(run, &item.views()))?;
            length = chunk;
        }
        Ok(length)
    }
}

/// What is known of a node type without making one.
pub struct NodeType {
    /// Its name in graph files.
    pub kind: &'static str,
    /// Raised when equal inputs give another output.
    pub version: u32,
    /// What it does.
    pub doc: String,
    /// Its parameters.
    pub params: Vec<ParamSpec>,
    /// Its ports.
    pub ports: Vec<PortSpec>,
    /// Type of the artifact it gives.
    pub output: &'static str,
    /// Whether that is nothing but numbers for people.
    pub figures: bool,
    /// Whether it gives a sequence.
    pub sequence: bool,
    make: fn() -> Box<dyn AnyNode>,
}

impl NodeType {
    fn of<N: Node>() -> Self {
        NodeType {
            kind: N::KIND,
            version: N::VERSION,
            doc: N::doc(),
            params: N::specs(),
            ports: N::In::ports(),
            output: <N::Out as Output>::Item::TYPE,
            figures: <N::Out as Output>::Item::FIGURES,
            sequence: N::Out::SEQUENCE,
            make: || Box::new(N::default()),
        }
    }

    /// Whether its artifacts become files for people: pictures and figures.
    pub fn published(&self) -> bool {
        self.figures || self.output == Picture::TYPE
    }

    /// A node of this type with every parameter at its default.
    pub fn make(&self) -> Box<dyn AnyNode> {
        (self.make)()
    }
}

/// All node types that graph files may name, sorted by name.
pub struct Registry {
    types: Vec<NodeType>,
}

impl Registry {
    /// The nodes of `lightloom-nodes`.
    pub fn builtin() -> Self {
        struct Add(Registry);
        impl lightloom_nodes::Visit for Add {
            fn node<N: Node>(&mut self) {
                self.0.types.push(NodeType::of::<N>());
            }
        }
        let mut add = Add(Registry { types: Vec::new() });
        lightloom_nodes::each(&mut add);
        add.0.types.sort_by_key(|t| t.kind);
        add.0
    }

    /// The same registry with one more node type, or with another one of that name.
    #[must_use]
    pub fn with<N: Node>(mut self) -> Self {
        self.types.retain(|t| t.kind != N::KIND);
        self.types.push(NodeType::of::<N>());
        self.types.sort_by_key(|t| t.kind);
        self
    }

    /// The type called `kind`.
    pub fn get(&self, kind: &str) -> Option<&NodeType> {
        self.types.iter().find(|t| t.kind == kind)
    }

    /// All types, sorted by name.
    pub fn types(&self) -> &[NodeType] {
        &self.types
    }
}
