//! What a store holds: its blobs with their sizes and last uses, and what their records say they cost.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::time::SystemTime;

use lightloom_nodes::node::Digest;

use super::blob::last_used;
use super::{Record, Store, StoreError};

/// What a store holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Usage {
    /// Blobs.
    pub blobs: u64,
    /// Bytes of all blobs: what the quota limits.
    pub bytes: u64,
    /// Most bytes of blobs that eviction leaves.
    pub quota: u64,
    /// Records.
    pub records: u64,
    /// Records whose blob was evicted: still good for planning.
    pub evicted: u64,
    /// Blobs that no record names.
    pub unnamed: u64,
    /// Bytes of those.
    pub unnamed_bytes: u64,
    /// Bytes of checkpoints of interrupted actions.
    pub checkpoint_bytes: u64,
    /// Bytes of what was found damaged in the last seven days.
    pub quarantine_bytes: u64,
    /// By kind of node.
    pub kinds: BTreeMap<String, KindUsage>,
}

/// What the nodes of one kind have in a store. A blob with several records counts for the one that took longest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KindUsage {
    /// Records.
    pub records: u64,
    /// Blobs.
    pub blobs: u64,
    /// Bytes of those blobs.
    pub bytes: u64,
    /// Seconds it took to make those blobs.
    pub seconds: f64,
}

/// A blob as the file system knows it.
#[derive(Debug)]
pub(super) struct Blob {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
    pub(super) used: SystemTime,
}

/// What it would take to make a blob again: the most of its records.
pub(super) struct Cost {
    pub(super) seconds: f64,
    node: String,
}

impl Store {
    /// What the store holds, counted now from its files.
    pub fn usage(&self) -> Result<Usage, StoreError> {
        let blobs = self.blobs()?;
        let mut usage = Usage { quota: self.quota, ..Usage::default() };
        let costs = self.costs(|record| {
            usage.records += 1;
            usage.evicted += u64::from(!blobs.contains_key(&record.output));
            usage.kinds.entry(record.node.clone()).or_default().records += 1;
        });
        for (digest, blob) in &blobs {
            usage.blobs += 1;
            usage.bytes += blob.bytes;
            if let Some(cost) = costs.get(digest) {
                let kind = usage.kinds.entry(cost.node.clone()).or_default();
                kind.blobs += 1;
                kind.bytes += blob.bytes;
                kind.seconds += cost.seconds;
            } else {
                usage.unnamed += 1;
                usage.unnamed_bytes += blob.bytes;
            }
        }
        let size = |shelf| {
            let files = self.listing(shelf).into_iter();
            files.filter_map(|(_, path)| Some(fs::metadata(path).ok()?.len())).sum()
        };
        usage.checkpoint_bytes = size("part");
        usage.quarantine_bytes = size("quarantine");
        Ok(usage)
    }

    /// All entries of a directory with fan-out, by digest.
    pub(super) fn all(&self, shelf: &str) -> Result<Vec<(Digest, PathBuf)>, StoreError> {
        let mut found = Vec::new();
        for byte in 0..=u8::MAX {
            found.append(&mut self.shelved(shelf, byte)?);
        }
        Ok(found)
    }

    /// All blobs, by digest.
    pub(super) fn blobs(&self) -> Result<BTreeMap<Digest, Blob>, StoreError> {
        let mut blobs = BTreeMap::new();
        for (digest, path) in self.all("cas")? {
            match fs::metadata(&path) {
                Ok(meta) => {
                    let blob = Blob { path, bytes: meta.len(), used: last_used(&meta) };
                    blobs.insert(digest, blob);
                }
                // Another process evicted it meanwhile.
                Err(cause) if cause.kind() == ErrorKind::NotFound => {}
                Err(cause) => return Err(StoreError::at("read", &path)(cause)),
            }
        }
        Ok(blobs)
    }

    /// The cost of each blob that a record names, by digest; `seen` gets every record on the way.
    pub(super) fn costs(&self, mut seen: impl FnMut(&Record)) -> BTreeMap<Digest, Cost> {
        let mut costs: BTreeMap<Digest, Cost> = BTreeMap::new();
        for (_, record) in self.records() {
            seen(&record);
            // What is no time at all (negative, not a number) counts as none.
            let seconds = record.seconds.max(0.0);
            if costs.get(&record.output).is_none_or(|cost| cost.seconds < seconds) {
                costs.insert(record.output, Cost { seconds, node: record.node });
            }
        }
        costs
    }
}

#[cfg(test)]
mod tests {
    use super::super::key_of;
    use super::super::tests::{open, put, record};
    use super::*;

    #[test]
    fn usage_counts_by_kind() {
        let (_dir, store) = open();
        put(&store, 1, 0, Some(1.5));
        put(&store, 1, 0, Some(2.5));
        put(&store, 2, 0, None);
        let mut scene = record("scene", b"scene", 0.25);
        scene.node = "Scene".to_owned();
        store.put_record(&scene).unwrap();
        fs::write(store.checkpoint_path(&key_of("part")), [0; 77]).unwrap();
        let usage = store.usage().unwrap();
        let clusters = KindUsage { records: 2, blobs: 1, bytes: 1000, seconds: 2.5 };
        let scene = KindUsage { records: 1, ..KindUsage::default() };
        let kinds = [("Clusters", clusters), ("Scene", scene)].map(|(k, v)| (k.to_owned(), v));
        assert_eq!(usage.kinds, BTreeMap::from(kinds));
        assert_eq!((usage.unnamed, usage.unnamed_bytes, usage.evicted), (1, 1000, 1));
        assert_eq!((usage.checkpoint_bytes, usage.quarantine_bytes), (77, 0));
    }
}
