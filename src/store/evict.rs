//! Keeping the cache within its quota.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, SystemTime};

use lightloom_nodes::node::Digest;

use super::clear::remove;
use super::contents::Blob;
use super::lock::{lock_at, remove_unheld};
use super::{Store, StoreError, is_older, locked};

const DAY: Duration = Duration::from_secs(24 * 3600);

/// A blob without a record is left alone this long after its last use: its record may be about to be written.
const GRACE: Duration = Duration::from_secs(3600);

/// What [`Store::evict`] or [`Store::clear`] removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evicted {
    /// Blobs removed.
    pub blobs: u64,
    /// Bytes of those blobs.
    pub bytes: u64,
    /// Bytes of the blobs that are left.
    pub left: u64,
}

impl Store {
    /// Removes blobs until 90 % of the quota is left, when they are over it. First go those without a record that
    /// nobody used for an hour, oldest first; then those with the least seconds to make again / bytes * recency, where
    /// recency is 1 / (1 + days since the last use). Blobs in `pinned` and all records stay, so that the result may
    /// still be over the quota. Does nothing while another process evicts. Also removes lock files of more than a day
    /// that nobody holds.
    pub fn evict(&self, pinned: &BTreeSet<Digest>) -> Result<Evicted, StoreError> {
        let before = total(&self.blobs()?);
        if before <= self.quota {
            return Ok(Evicted { left: before, ..Evicted::default() });
        }
        let Some(_turn) = lock_at(&self.root.join("lock").join("evict"))? else {
            return Ok(Evicted { left: before, ..Evicted::default() });
        };
        // Counted again: whoever had the turn before may have removed enough.
        let blobs = self.blobs()?;
        let mut done = Evicted { left: total(&blobs), ..Evicted::default() };
        if done.left <= self.quota {
            return Ok(done);
        }
        let goal = self.quota - self.quota / 10;
        for (digest, blob) in self.order(&blobs) {
            if done.left <= goal {
                break;
            }
            if pinned.contains(&digest) {
                continue;
            }
            remove(&blob.path)?;
            locked(&self.trusted).remove(&digest);
            done.blobs += 1;
            done.bytes += blob.bytes;
            done.left -= blob.bytes;
        }
        for (_, path) in self.all("lock")? {
            if is_older(&path, DAY) {
                // What somebody took or removed meanwhile needs no removal.
                remove_unheld(&path).ok();
            }
        }
        Ok(done)
    }

    /// The blobs that may go, first to last.
    fn order<'b>(&self, blobs: &'b BTreeMap<Digest, Blob>) -> Vec<(Digest, &'b Blob)> {
        let now = SystemTime::now();
        let costs = self.costs(|_| {});
        let (mut unnamed, mut named) = (Vec::new(), Vec::new());
        for (digest, blob) in blobs {
            // A time to come (another host's clock) is as good as now.
            let idle = now.duration_since(blob.used).unwrap_or_default();
            match costs.get(digest) {
                Some(cost) => named.push((worth(cost.seconds, blob.bytes, idle), *digest, blob)),
                None if idle > GRACE => unnamed.push((blob.used, *digest, blob)),
                None => {}
            }
        }
        unnamed.sort_by_key(|(used, digest, _)| (*used, *digest));
        named.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let unnamed = unnamed.into_iter().map(|(_, digest, blob)| (digest, blob));
        unnamed.chain(named.into_iter().map(|(_, digest, blob)| (digest, blob))).collect()
    }
}

fn total(blobs: &BTreeMap<Digest, Blob>) -> u64 {
    blobs.values().map(|blob| blob.bytes).sum()
}

/// Seconds saved for each byte kept, less the longer nobody asked.
fn worth(seconds: f64, bytes: u64, idle: Duration) -> f64 {
    let days = idle.as_secs_f64() / DAY.as_secs_f64();
    seconds / bytes.max(1) as f64 / (1.0 + days)
}

#[cfg(test)]
mod tests {
    use super::super::key_of;
    use super::super::tests::{open, put};
    use super::*;
    use std::fs::File;

    fn left(store: &Store) -> Vec<Digest> {
        store.blobs().unwrap().into_keys().collect()
    }

    #[test]
    fn the_cheapest_for_its_size_and_age_goes_first() {
        let (dir, _) = open();
        let store = Store::open(dir.path(), Some(u64::MAX)).unwrap();
        let mut order = vec![
            put(&store, 1, 30, None),          // without a record, oldest
            put(&store, 2, 2, None),           // without a record
            put(&store, 3, 0, Some(0.1)),      // worth 0.1
            put(&store, 4, 24 * 9, Some(2.0)), // worth 2 / 10
            put(&store, 5, 0, Some(1.0)),      // worth 1
            put(&store, 6, 24, Some(4.0)),     // worth 4 / 2
            put(&store, 7, 0, Some(3.0)),      // worth 3
        ];
        let young = put(&store, 8, 0, None); // without a record, but of this hour
        assert_eq!(
            store.evict(&BTreeSet::new()).unwrap(),
            Evicted { left: 8000, ..Evicted::default() }
        );
        while !order.is_empty() {
            // One byte too many: a tenth of the quota has to go, which is one blob.
            let quota = (order.len() as u64 + 1) * 1000 - 1;
            let store = Store::open(dir.path(), Some(quota)).unwrap();
            let done = store.evict(&BTreeSet::new()).unwrap();
            assert_eq!((done.blobs, done.bytes, done.left), (1, 1000, quota - 999));
            order.remove(0);
            let mut expected = order.clone();
            expected.push(young);
            expected.sort();
            assert_eq!(left(&store), expected);
        }
    }

    #[test]
    fn the_dearest_of_several_records_counts() {
        let (dir, store) = open();
        let shared = put(&store, 1, 0, Some(0.5));
        put(&store, 1, 0, Some(50.0));
        put(&store, 1, 0, Some(0.1));
        put(&store, 2, 0, Some(5.0));
        let tight = Store::open(dir.path(), Some(1500)).unwrap();
        tight.evict(&BTreeSet::new()).unwrap();
        assert_eq!(left(&tight), [shared]);
    }

    #[test]
    fn pinned_blobs_stay_even_over_the_quota() {
        let (dir, store) = open();
        let pins = BTreeSet::from([put(&store, 1, 9000, Some(0.0)), put(&store, 2, 9000, None)]);
        put(&store, 3, 0, Some(1e9));
        let tight = Store::open(dir.path(), Some(10)).unwrap();
        let done = tight.evict(&pins).unwrap();
        assert_eq!((done.blobs, done.left), (1, 2000));
        assert_eq!(left(&tight), pins.into_iter().collect::<Vec<_>>());
    }

    #[test]
    fn ninety_percent_are_left_and_records_outlive_blobs() {
        let (dir, store) = open();
        for byte in 0..20 {
            put(&store, byte, 0, Some(f64::from(byte)));
        }
        let tight = Store::open(dir.path(), Some(10_000)).unwrap();
        let done = tight.evict(&BTreeSet::new()).unwrap();
        assert_eq!((done.blobs, done.left), (11, 9000));
        assert_eq!(tight.records().count(), 20);
        let usage = tight.usage().unwrap();
        assert_eq!((usage.records, usage.evicted, usage.blobs, usage.bytes), (20, 11, 9, 9000));

        // An evicted blob is a miss that its record survives, and can be put again.
        let gone = tight.record(&key_of("3 3")).unwrap();
        assert!(tight.open_blob(&gone.output, gone.bytes).unwrap().is_none());
        tight.put_blob(&[3; 1000]).unwrap();
        assert!(tight.open_blob(&gone.output, gone.bytes).unwrap().is_some());
        assert_eq!(tight.damage(), []);
    }

    #[test]
    fn times_that_are_none_do_not_break_the_order() {
        for (seconds, bytes) in [(0.0, 0), (f64::MAX, 0), (f64::INFINITY, 1), (1e-300, u64::MAX)] {
            assert!(worth(seconds, bytes, Duration::MAX) >= 0.0);
        }
        let (dir, store) = open();
        for (byte, seconds) in [(1, f64::NAN), (2, -1.0), (3, f64::NEG_INFINITY)] {
            put(&store, byte, 0, Some(seconds));
        }
        let dear = put(&store, 4, 0, Some(1.0));
        Store::open(dir.path(), Some(1200)).unwrap().evict(&BTreeSet::new()).unwrap();
        assert_eq!(left(&store), [dear]);
    }

    #[test]
    fn a_mapped_blob_can_be_evicted_and_only_one_process_evicts() {
        let (dir, store) = open();
        let digest = put(&store, 1, 0, Some(1.0));
        let map = store.open_blob(&digest, 1000).unwrap().unwrap();
        let tight = Store::open(dir.path(), Some(0)).unwrap();
        let turn = lock_at(&store.root.join("lock/evict")).unwrap().unwrap();
        assert_eq!(tight.evict(&BTreeSet::new()).unwrap().left, 1000);
        drop(turn);
        assert_eq!(tight.evict(&BTreeSet::new()).unwrap().left, 0);
        assert_eq!(map[..], [1; 1000]);
        assert!(store.open_blob(&digest, 1000).unwrap().is_none());
    }

    #[test]
    fn old_locks_go_unless_they_are_held() {
        let (dir, store) = open();
        put(&store, 1, 0, Some(1.0));
        let held = store.lock(&key_of("held")).unwrap();
        for name in ["held", "old", "new"] {
            drop(store.lock(&key_of(name)).unwrap());
            let days = if name == "new" { 0 } else { 2 };
            let file = File::open(store.shelf("lock", &key_of(name))).unwrap();
            file.set_modified(SystemTime::now() - days * DAY).unwrap();
        }
        Store::open(dir.path(), Some(0)).unwrap().evict(&BTreeSet::new()).unwrap();
        let there = ["held", "old", "new"].map(|name| store.shelf("lock", &key_of(name)).exists());
        assert_eq!(there, [true, false, true]);
        drop(held);
    }
}
