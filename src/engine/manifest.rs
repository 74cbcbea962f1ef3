//! The manifest of an action: everything that can change its result, as lines of text. The same text
//! is hashed to make the key and shown to explain it.

use super::bindings::Held;
use crate::graph::GraphNode;
use crate::store::{Store, StoreError, key_of};
use lightloom_nodes::node::Digest;
use std::fmt::Write as _;
use std::ops::Range;

/// The manifest of one execution, before it is told apart by item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Manifest(String);

impl Manifest {
    /// Kind, version, parameters, content of files, and content of inputs; nothing else counts.
    pub fn new(node: &GraphNode, files: &[Digest], inputs: &[(&'static str, Vec<Held>)]) -> Self {
        let mut text = format!("kind {}\nversion {}\n", node.kind, node.version);
        for (name, value) in node.node.canonical() {
            let _ = writeln!(text, "param {name} = {value}");
        }
        for (i, digest) in files.iter().enumerate() {
            let _ = writeln!(text, "file {i} = {digest}");
        }
        for (port, held) in inputs {
            let _ = write!(text, "input {port} =");
            held.iter().for_each(|h| {
                let _ = write!(text, " {}", h.digest);
            });
            text.push('\n');
        }
        Manifest(text)
    }

    /// The digests of every file that a node reads.
    ///
    /// # Errors
    /// When one cannot be read.
    pub fn files(node: &GraphNode, store: &Store) -> Result<Vec<Digest>, StoreError> {
        node.node.reads().iter().map(|path| store.file_digest(path)).collect()
    }

    /// The text of one item among those the execution gives.
    pub fn item(&self, item: usize, items: &Range<usize>) -> String {
        if items.len() == 1 {
            return self.0.clone();
        }
        format!("{}item {} of {}\n", self.0, item - items.start, items.len())
    }

    /// The key of that text.
    pub fn item_key(&self, item: usize, items: &Range<usize>) -> Digest {
        key_of(&self.item(item, items))
    }

    /// The key of the execution as a whole.
    pub fn key(&self) -> Digest {
        key_of(&self.0)
    }

    /// Its lines, label and value.
    pub fn lines(text: &str) -> Vec<(&str, &str)> {
        text.lines().map(|line| line.split_once(" = ").unwrap_or((line, ""))).collect()
    }
}
