//! The contract of a node: a pure, typed function of its parameters and inputs.
//!
//! The law: whatever can change the output is a parameter, an input or a file (seeds, precision and
//! visibility method included); whatever cannot (threads, progress, cancellation) is in [`Ctx`].

mod context;
mod digest;
mod params;
mod ports;
mod values;

pub use context::{Ctx, Derived};
pub use digest::Digest;
pub use params::{ParamSpec, Params, Problems};
pub use ports::{
    All, Binder, Cardinality, Inputs, Item, Many, Output, Port, PortSpec, Sequence, Sizes, Window,
};
pub use values::{Choice, File, ParamValue, parse_number};

use std::path::PathBuf;

/// What a node can end with besides its output. Every message names the thing it is about.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The run was asked to stop; nothing is wrong.
    #[error("cancelled")]
    Cancelled,
    /// A file is missing, broken, or of a kind this node cannot read.
    #[error("{}: {what}", path.display())]
    File {
        /// The file as the graph names it, resolved against the graph's folder.
        path: PathBuf,
        /// What was found and what was expected.
        what: String,
    },
    /// An input or a combination of parameters that has no answer.
    #[error("{0}")]
    Invalid(String),
}

impl Error {
    /// An [`Error::Invalid`] from anything that prints.
    pub fn invalid(what: impl Into<String>) -> Self {
        Error::Invalid(what.into())
    }

    /// An [`Error::File`] from a path and anything that prints.
    pub fn file(path: impl Into<PathBuf>, what: impl std::fmt::Display) -> Self {
        Error::File { path: path.into(), what: what.to_string() }
    }
}

/// One kind of node. The value of the type is its parameters as written in the graph file.
pub trait Node: Params {
    /// Its name in graph files: the Rust type's own name.
    const KIND: &'static str;
    /// Raised when equal inputs would give another output, so that old results are not reused.
    const VERSION: u32;
    /// One named port per field.
    type In: Inputs;
    /// One artifact, or a [`Sequence`] of them.
    type Out: Output;

    /// The one port at which several runs may differ and still share most of their work; see
    /// [`Node::run_together`].
    const SHARES: Option<&'static str> = None;

    /// Reports parameters that are each in range but do not fit together.
    fn check(&self, _problems: &mut Problems) {}

    /// Every file whose content decides the output: the `File` parameters and what those reference.
    fn reads(&self) -> Vec<PathBuf> {
        self.files()
    }

    /// Peak bytes allocated by [`Node::run`] beyond its mapped inputs, for the scheduler.
    fn memory(&self, inputs: &Sizes) -> u64 {
        inputs.total()
    }

    /// Computes the output. Equal parameters, inputs and files give equal bytes.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when the context says so; otherwise a message that names what is wrong.
    fn run(&self, input: Self::In, ctx: &Ctx) -> Result<Self::Out, Error>;

    /// Computes the outputs of several runs whose inputs are equal but for the port that
    /// [`Node::SHARES`] names, for a node that does so in less time than one after the other. Each
    /// output has the bits that [`Node::run`] gives.
    ///
    /// # Errors
    /// Those of [`Node::run`], of any of them.
    fn run_together(&self, runs: Vec<(Self::In, &Ctx)>) -> Result<Vec<Self::Out>, Error> {
        runs.into_iter().map(|(input, ctx)| self.run(input, ctx)).collect()
    }
}
