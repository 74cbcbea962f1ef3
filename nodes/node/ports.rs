//! Ports: how a node receives artifacts and gives them.
//!
//! A port is [`Item`] (one artifact), `Option<Item>`, [`Many`] (several nodes), [`All`] (a whole
//! sequence, items loaded when asked for), `Option<All>`, or [`Window`] (items k and k+1).

use super::{Digest, Error};
use crate::data::Data;
use std::ops::Deref;
use std::sync::Arc;

/// One artifact with the digest of its content; reads like the artifact itself.
#[derive(Debug)]
pub struct Item<T> {
    value: Arc<T>,
    digest: Digest,
}

impl<T> Clone for Item<T> {
    fn clone(&self) -> Self {
        Item { value: Arc::clone(&self.value), digest: self.digest }
    }
}

impl<T> Deref for Item<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T> Item<T> {
    /// An artifact whose digest is known, as the engine has it.
    pub fn new(value: Arc<T>, digest: Digest) -> Self {
        Item { value, digest }
    }

    /// The digest of the artifact's bytes: a name for its content.
    pub fn digest(&self) -> Digest {
        self.digest
    }
}

impl<T: Data> From<T> for Item<T> {
    /// For using nodes without a graph: the digest is computed here.
    fn from(value: T) -> Self {
        let digest = Digest::of(&crate::data::encode(&value));
        Item { value: Arc::new(value), digest }
    }
}

/// A whole sequence; an item is loaded when it is asked for and dropped with its last reader.
pub struct All<T> {
    digests: Vec<Digest>,
    load: Arc<dyn Fn(usize) -> Result<Arc<T>, Error> + Send + Sync>,
}

impl<T> Clone for All<T> {
    fn clone(&self) -> Self {
        All { digests: self.digests.clone(), load: Arc::clone(&self.load) }
    }
}

impl<T> All<T> {
    /// A sequence of known digests whose items `load` reads.
    pub fn new(
        digests: Vec<Digest>,
        load: impl Fn(usize) -> Result<Arc<T>, Error> + Send + Sync + 'static,
    ) -> Self {
        All { digests, load: Arc::new(load) }
    }

    /// How many items there are.
    pub fn len(&self) -> usize {
        self.digests.len()
    }

    /// Whether there is no item.
    pub fn is_empty(&self) -> bool {
        self.digests.is_empty()
    }

    /// Item `k`.
    ///
    /// # Errors
    /// When there is no item `k`, or it cannot be read.
    pub fn get(&self, k: usize) -> Result<Item<T>, Error> {
        let Some(&digest) = self.digests.get(k) else {
            return Err(Error::invalid(format!(
                "item {k} of a sequence of {} was asked for",
                self.len()
            )));
        };
        Ok(Item { value: (self.load)(k)?, digest })
    }
}

impl<T> All<T> {
    /// Item `k` of a sequence, or the only item where there is one for all `k`.
    ///
    /// # Errors
    /// As [`All::get`].
    pub fn broadcast(&self, k: usize) -> Result<Item<T>, Error> {
        self.get(if self.len() == 1 { 0 } else { k })
    }
}

impl<T: Send + Sync + 'static> All<T> {
    /// The sequence of one item.
    pub fn one(item: Item<T>) -> Self {
        All::new(vec![item.digest], move |_| Ok(Arc::clone(&item.value)))
    }
}

impl<T: Data> From<Vec<Item<T>>> for All<T> {
    fn from(items: Vec<Item<T>>) -> Self {
        let digests = items.iter().map(Item::digest).collect();
        All::new(digests, move |k| Ok(Arc::clone(&items[k].value)))
    }
}

/// The artifacts of several nodes, in the order of the graph file.
pub struct Many<T>(pub Vec<Item<T>>);

impl<T> Deref for Many<T> {
    type Target = [Item<T>];
    fn deref(&self) -> &[Item<T>] {
        &self.0
    }
}

/// Items k and k+1 of a sequence.
pub struct Window<T> {
    /// Item k.
    pub this: Item<T>,
    /// Item k+1.
    pub next: Item<T>,
}

/// How many artifacts a port takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cardinality {
    /// Exactly one.
    One,
    /// One or none.
    Optional,
    /// The artifacts of one or more nodes.
    Many,
    /// Every item of a sequence.
    All,
    /// Every item of a sequence, or nothing.
    OptionalAll,
    /// Two neighbouring items of a sequence.
    Window,
}

/// What the catalogue says of one port.
#[derive(Clone, Debug)]
pub struct PortSpec {
    /// Name in graph files.
    pub name: &'static str,
    /// Artifact type.
    pub data: &'static str,
    /// How many.
    pub cardinality: Cardinality,
    /// Meaning.
    pub doc: String,
}

/// Hands out the artifacts bound to a port; the engine's side of [`Port::bind`].
pub trait Binder {
    /// The artifacts bound to `port`, in order; empty when nothing is.
    ///
    /// # Errors
    /// When the graph has a port of another type under that name.
    fn bound<T: Data>(&self, port: &'static str) -> Result<All<T>, Error>;
}

/// A type that a field of an [`Inputs`] struct may have.
pub trait Port: Sized {
    /// How many artifacts it takes.
    const CARDINALITY: Cardinality;
    /// Type of the artifacts.
    const DATA: &'static str;
    /// Takes its artifacts from the engine.
    ///
    /// # Errors
    /// When an artifact is missing or cannot be read.
    fn bind(binder: &impl Binder, name: &'static str) -> Result<Self, Error>;
}

impl<T: Data> Port for Item<T> {
    const CARDINALITY: Cardinality = Cardinality::One;
    const DATA: &'static str = T::TYPE;
    fn bind(binder: &impl Binder, name: &'static str) -> Result<Self, Error> {
        binder.bound(name)?.get(0)
    }
}

impl<T: Data> Port for Option<Item<T>> {
    const CARDINALITY: Cardinality = Cardinality::Optional;
    const DATA: &'static str = T::TYPE;
    fn bind(binder: &impl Binder, name: &'static str) -> Result<Self, Error> {
        let all = binder.bound(name)?;
        if all.is_empty() { Ok(None) } else { all.get(0).map(Some) }
    }
}

impl<T: Data> Port for Many<T> {
    const CARDINALITY: Cardinality = Cardinality::Many;
    const DATA: &'static str = T::TYPE;
    fn bind(binder: &impl Binder, name: &'static str) -> Result<Self, Error> {
        let all = binder.bound(name)?;
        (0..all.len()).map(|k| all.get(k)).collect::<Result<_, _>>().map(Many)
    }
}

impl<T: Data> Port for All<T> {
    const CARDINALITY: Cardinality = Cardinality::All;
    const DATA: &'static str = T::TYPE;
    fn bind(binder: &impl Binder, name: &'static str) -> Result<Self, Error> {
        binder.bound(name)
    }
}

impl<T: Data> Port for Option<All<T>> {
    const CARDINALITY: Cardinality = Cardinality::OptionalAll;
    const DATA: &'static str = T::TYPE;
    fn bind(binder: &impl Binder, name: &'static str) -> Result<Self, Error> {
        let all = binder.bound(name)?;
        Ok((!all.is_empty()).then_some(all))
    }
}

impl<T: Data> Port for Window<T> {
    const CARDINALITY: Cardinality = Cardinality::Window;
    const DATA: &'static str = T::TYPE;
    fn bind(binder: &impl Binder, name: &'static str) -> Result<Self, Error> {
        let all = binder.bound(name)?;
        Ok(Window { this: all.get(0)?, next: all.get(1)? })
    }
}

/// The ports of a node, one a field. Implemented by [`inputs!`](crate::inputs).
pub trait Inputs: Sized {
    /// All ports in the order of declaration.
    fn ports() -> Vec<PortSpec>;
    /// Takes every port's artifacts from the engine.
    ///
    /// # Errors
    /// When an artifact is missing or cannot be read.
    fn bind(binder: &impl Binder) -> Result<Self, Error>;
}

impl Inputs for () {
    fn ports() -> Vec<PortSpec> {
        Vec::new()
    }
    fn bind(_: &impl Binder) -> Result<Self, Error> {
        Ok(())
    }
}

/// Declares the ports of a node: documentation, name and type on one line each.
#[macro_export]
macro_rules! inputs {
    ( $(#[doc = $doc:literal])* pub struct $name:ident { $( $(#[doc = $fdoc:literal])* $field:ident : $ty:ty ),* $(,)? } ) => {
        $(#[doc = $doc])*
        pub struct $name { $( $(#[doc = $fdoc])* pub $field: $ty ),* }
        impl $crate::node::Inputs for $name {
            fn ports() -> Vec<$crate::node::PortSpec> {
                vec![$( $crate::node::PortSpec {
                    name: stringify!($field),
                    data: <$ty as $crate::node::Port>::DATA,
                    cardinality: <$ty as $crate::node::Port>::CARDINALITY,
                    doc: [$($fdoc),*].map(str::trim).join(" "),
                } ),*]
            }
            fn bind(binder: &impl $crate::node::Binder) -> Result<Self, $crate::node::Error> {
                Ok($name { $( $field: <$ty as $crate::node::Port>::bind(binder, stringify!($field))? ),* })
            }
        }
    };
}

/// A sequence that a node gives, with the length of the chunks in which `All` ports will see it.
pub struct Sequence<T> {
    /// The items in order.
    pub items: Vec<T>,
    /// Items per chunk; the last chunk may be shorter. Only a node without a sequence among its
    /// inputs decides it; elsewhere the chunks of the inputs stay.
    pub chunk: usize,
}

/// What [`Node::run`](super::Node::run) may give: an artifact, or a [`Sequence`] of them.
pub trait Output {
    /// The artifact.
    type Item: Data;
    /// Whether it is a sequence.
    const SEQUENCE: bool;
    /// The items, and how many make a chunk.
    fn into_items(self) -> (Vec<Self::Item>, usize);
}

impl<T: Data> Output for T {
    type Item = T;
    const SEQUENCE: bool = false;
    fn into_items(self) -> (Vec<T>, usize) {
        (vec![self], 1)
    }
}

impl<T: Data> Output for Sequence<T> {
    type Item = T;
    const SEQUENCE: bool = true;
    fn into_items(self) -> (Vec<T>, usize) {
        (self.items, self.chunk.max(1))
    }
}

/// What the scheduler knows of a node's inputs before it runs: items and bytes of each port.
#[derive(Clone, Debug, Default)]
pub struct Sizes(pub Vec<(&'static str, Vec<u64>)>);

impl Sizes {
    /// Number of items bound to `port`.
    pub fn items(&self, port: &str) -> u64 {
        self.of(port).len() as u64
    }

    /// Bytes of all items bound to `port`.
    pub fn bytes(&self, port: &str) -> u64 {
        self.of(port).iter().sum()
    }

    /// Bytes of all inputs.
    pub fn total(&self) -> u64 {
        self.0.iter().flat_map(|(_, sizes)| sizes).sum()
    }

    fn of(&self, port: &str) -> &[u64] {
        self.0.iter().find(|(name, _)| *name == port).map_or(&[], |(_, sizes)| sizes)
    }
}
