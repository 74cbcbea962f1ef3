//! What a node is given when it runs: artifacts of the cache, opened when they are asked for.

use crate::store::Store;
use lightloom_nodes::data::{Bytes, Data, decode};
use lightloom_nodes::node::{All, Binder, Digest, Error, Sizes};
use memmap2::Mmap;
use std::sync::Arc;

/// An artifact in the cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Held {
    /// Digest of its bytes.
    pub digest: Digest,
    /// Their number.
    pub bytes: u64,
}

/// The artifacts bound to every port of one execution.
#[derive(Clone)]
pub struct Bindings {
    store: Arc<Store>,
    ports: Vec<(&'static str, Vec<Held>)>,
}

struct Mapped(Arc<Mmap>);

impl AsRef<[u8]> for Mapped {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl Bindings {
    /// Bindings of the ports that have any.
    pub fn new(store: Arc<Store>, ports: Vec<(&'static str, Vec<Held>)>) -> Self {
        Bindings { store, ports }
    }

    /// Items and bytes of each port.
    pub fn sizes(&self) -> Sizes {
        Sizes(
            self.ports
                .iter()
                .map(|(name, held)| (*name, held.iter().map(|h| h.bytes).collect()))
                .collect(),
        )
    }
}

impl Binder for Bindings {
    fn bound<T: Data>(&self, port: &'static str) -> Result<All<T>, Error> {
        let held = self
            .ports
            .iter()
            .find(|(name, _)| *name == port)
            .map_or(&[][..], |(_, held)| held)
            .to_vec();
        let digests = held.iter().map(|h| h.digest).collect();
        let store = Arc::clone(&self.store);
        Ok(All::new(digests, move |k| {
            let Held { digest, bytes } = held[k];
            let found =
                store.open_blob(&digest, bytes).map_err(|e| Error::invalid(e.to_string()))?;
            let lost = || {
                Error::invalid(format!(
                    "blob {} of port `{port}` is gone from the cache",
                    digest.short()
                ))
            };
            let bytes: Bytes = Arc::new(Mapped(found.ok_or_else(lost)?));
            decode(bytes).map(Arc::new)
        }))
    }
}
