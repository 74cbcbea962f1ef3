//! Records: what an action was, what came out and what it cost. A few hundred bytes of RON that outlive their blobs.

use std::fs;
use std::io::ErrorKind;

use lightloom_nodes::node::Digest;
use ron::ser::PrettyConfig;
use serde::{Deserialize, Serialize};

use super::digest::{key_of, seal, unseal};
use super::{Damage, Store, StoreError};

/// The account of one action that was done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Canonical description of the action: kind, version, parameters, digests of inputs and files. Its key is
    /// [`key_of`] of this text.
    pub manifest: String,
    /// Kind of the node, as in graph files.
    pub node: String,
    /// Name of the node in the graph that asked first.
    pub name: String,
    /// The blob that came out.
    pub output: Digest,
    /// Size of that blob.
    pub bytes: u64,
    /// Wall clock time of the computation, in seconds.
    pub seconds: f64,
    /// Processor time of it, in seconds, over all threads.
    pub cpu_seconds: f64,
    /// Whether those times are its own: false when another execution ran at the same time, whose work
    /// cannot be told apart, or when one pass served several.
    pub alone: bool,
    /// Name of the host that did it.
    pub host: String,
    /// Matrix elements it stands for; the same on every machine.
    pub evaluations: u64,
    /// Most memory the process had held by then, in bytes.
    pub peak_bytes: u64,
    /// When it ended, in seconds since 1970 (UTC).
    pub made: u64,
    /// Version of the program that did it.
    pub version: String,
    /// What the node reported: counted repairs and fallbacks.
    pub notes: Vec<String>,
}

impl Store {
    /// The record of the action `key`. A miss is None; so is a torn or damaged record, which goes to the quarantine
    /// and is reported by [`Store::damage`], and one whose fields this version does not know.
    pub fn record(&self, key: &Digest) -> Option<Record> {
        let path = self.shelf("ac", key);
        let sealed = match fs::read(&path) {
            Ok(sealed) => sealed,
            Err(cause) if cause.kind() == ErrorKind::NotFound => return None,
            Err(cause) => {
                self.note(Damage {
                    path,
                    moved: None,
                    problem: format!("cannot be read: {cause}"),
                });
                return None;
            }
        };
        let Some(text) = unseal(&sealed) else {
            self.quarantine("ac", key, "the record is torn or was altered".to_owned());
            return None;
        };
        // As it was written, so another version wrote it: no damage, and nothing to understand either.
        let record: Record = ron::from_str(text).ok()?;
        if key_of(&record.manifest) != *key {
            self.quarantine("ac", key, "the record is of another action".to_owned());
            return None;
        }
        Some(record)
    }

    /// Writes a record under the key of its manifest, which is returned, in place of the one that is there. The blob
    /// must have been put before.
    pub fn put_record(&self, record: &Record) -> Result<Digest, StoreError> {
        let key = key_of(&record.manifest);
        let path = self.shelf("ac", &key);
        // Unescaped, so that the lines of the manifest are lines for whoever reads the file.
        let style = PrettyConfig::new().struct_names(true).escape_strings(false);
        match ron::ser::to_string_pretty(record, style) {
            Ok(text) => self.put_text(&path, &seal(&text)).map(|()| key),
            Err(cause) => Err(StoreError::Record { path, cause }),
        }
    }

    /// All readable records with their keys, in the order of the keys.
    pub fn records(&self) -> impl Iterator<Item = (Digest, Record)> + '_ {
        let keys = (0..=u8::MAX).flat_map(|byte| match self.shelved("ac", byte) {
            Ok(keys) => keys,
            Err(error) => {
                let path = self.root.join("ac").join(format!("{byte:02x}"));
                self.note(Damage { path, moved: None, problem: error.to_string() });
                Vec::new()
            }
        });
        keys.filter_map(|(key, _)| Some((key, self.record(&key)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{files, keys, open, record};
    use super::*;
    use std::time::Instant;

    #[test]
    fn any_text_and_any_number_come_back() {
        let (_dir, store) = open();
        let nasty =
            ["", "a\r\nb\t\0\u{7f}", "\"# \"## r#\"", "\\n \\", "// x\n*/ {}", "\u{fc}\u{1F4A1}"];
        for (text, seconds) in
            nasty.iter().zip([0.0, 1e-300, 0.1 + 0.2, f64::MAX, f64::INFINITY, 3.0])
        {
            let mut written = record(text, b"blob", seconds);
            written.notes = nasty.map(str::to_owned).to_vec();
            let key = store.put_record(&written).unwrap();
            assert_eq!(store.record(&key), Some(written));
        }
        assert_eq!(store.damage(), []);
    }

    #[test]
    fn a_newer_record_replaces_the_older() {
        let (_dir, store) = open();
        let key = store.put_record(&record("a", b"one", 1.0)).unwrap();
        store.put_record(&record("a", b"two", 2.0)).unwrap();
        assert_eq!(store.record(&key), Some(record("a", b"two", 2.0)));
        assert_eq!(files(&store.root.join("tmp")), 0);
    }

    #[test]
    fn torn_and_exchanged_records_are_misses_and_reported() {
        let (_dir, store) = open();
        let key = store.put_record(&record("a", b"blob", 1.0)).unwrap();
        let path = store.shelf("ac", &key);
        let text = fs::read(&path).unwrap();
        for (at, bad) in [&text[..text.len() / 2], b"", &[0; 300]].into_iter().enumerate() {
            fs::write(&path, bad).unwrap();
            assert_eq!(store.record(&key), None);
            let damage = &store.damage()[at];
            assert_eq!(fs::read(damage.moved.as_ref().unwrap()).unwrap(), bad);
            assert!(!path.exists());
        }
        let other = store.put_record(&record("b", b"blob", 1.0)).unwrap();
        fs::rename(store.shelf("ac", &other), &path).ok();
        store.put_record(&record("b", b"blob", 1.0)).unwrap();
        assert_eq!(store.record(&key), None);
        assert_eq!(store.records().map(|(key, _)| key).collect::<Vec<_>>(), [other]);
        assert_eq!(store.damage().len(), 4);
        let shown = store.damage()[3].to_string();
        assert!(shown.contains("another action") && shown.contains("quarantine"), "{shown}");
    }

    #[test]
    fn a_record_of_another_version_is_a_miss_and_stays() {
        let (_dir, store) = open();
        let key = key_of("a");
        store.put_text(&store.shelf("ac", &key), &seal("Record(manifest: \"a\")")).unwrap();
        assert_eq!(store.record(&key), None);
        assert_eq!(store.damage(), []);
        assert!(store.shelf("ac", &key).exists());
    }

    #[test]
    fn iteration_gives_every_record_once_in_order() {
        let (_dir, store) = open();
        let manifests = keys(500);
        for manifest in &manifests {
            store.put_record(&record(manifest, b"blob", 1.0)).unwrap();
        }
        fs::write(store.root.join("ac/00-foreign"), "x").unwrap();
        let found: Vec<_> = store.records().map(|(key, _)| key).collect();
        let mut expected: Vec<_> = manifests.iter().map(|manifest| key_of(manifest)).collect();
        expected.sort();
        assert_eq!(found, expected);

        let start = Instant::now();
        let hits = expected.iter().filter(|key| store.record(key).is_some()).count();
        println!("{hits} records read in {:?}", start.elapsed());
        assert_eq!(hits, 500);
    }
}
