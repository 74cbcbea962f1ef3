//! Blobs: results named by the digest of their bytes, written once, read through a memory map.

use std::fs::{File, FileTimes, Metadata, Permissions};
use std::io::{self, ErrorKind, Write};
use std::mem::take;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use lightloom_nodes::node::Digest;
use memmap2::Mmap;

use super::files::{Stamp, digest_of};
use super::temp::Temp;
use super::{Store, StoreError, locked};

/// Bytes gathered before they are hashed and written: enough for the wide paths of BLAKE3.
const GATHER: usize = 256 * 1024;

/// Accesses closer together than this are noted as one.
const SAME_ACCESS: Duration = Duration::from_secs(60);

impl Store {
    /// Stores `bytes`; gives their digest and count. Nothing is written when the store has them already, intact.
    pub fn put_blob(&self, bytes: &[u8]) -> Result<(Digest, u64), StoreError> {
        let (digest, count) = (Digest::of(bytes), bytes.len() as u64);
        if self.open_blob(&digest, count)?.is_none() {
            let mut temp = self.temp()?;
            temp.file.write_all(bytes).map_err(StoreError::writing(&temp.path, count))?;
            self.keep_blob(temp, &digest)?;
        }
        Ok((digest, count))
    }

    /// A writer for a blob that is made piece by piece. `expected` is its size in bytes as far as it is known, 0 when
    /// it is not; it only serves to say how much room a full disk lacks.
    pub fn blob_writer(&self, expected: u64) -> Result<BlobWriter<'_>, StoreError> {
        Ok(BlobWriter {
            store: self,
            temp: self.temp()?,
            hasher: blake3::Hasher::new(),
            gathered: Vec::new(),
            written: 0,
            expected,
            failed: false,
        })
    }

    /// Where the blob `digest` lies, or would lie, in the cache: a safetensors file without an extension.
    pub fn blob_path(&self, digest: &Digest) -> PathBuf {
        self.shelf("cas", digest)
    }

    /// The blob `digest` of `bytes` bytes, mapped; None when the store does not have it. A blob of another size, or
    /// with another digest when it is first opened here (unless this store wrote it), goes to the quarantine, is
    /// reported by [`Store::damage`] and is None as well. The map stays valid when the blob is evicted meanwhile.
    pub fn open_blob(&self, digest: &Digest, bytes: u64) -> Result<Option<Arc<Mmap>>, StoreError> {
        let path = self.shelf("cas", digest);
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(cause) if cause.kind() == ErrorKind::NotFound => return Ok(None),
            Err(cause) => return Err(StoreError::at("open", &path)(cause)),
        };
        let meta = file.metadata().map_err(StoreError::at("read", &path))?;
        let stamp = Stamp::of_content(&meta);
        if stamp.size != bytes {
            let problem = format!("the blob has {} bytes in place of {bytes}", stamp.size);
            self.quarantine("cas", digest, problem);
            return Ok(None);
        }
        if locked(&self.trusted).get(digest) != Some(&stamp) {
            let problem = match digest_of(&file) {
                Ok(found) if found == *digest => None,
                Ok(found) => Some(format!("the blob was altered, its digest is {found}")),
                Err(cause) => Some(format!("the blob cannot be read: {cause}")),
            };
            if let Some(problem) = problem {
                self.quarantine("cas", digest, problem);
                return Ok(None);
            }
            locked(&self.trusted).insert(*digest, stamp);
        }
        note_access(&file, &meta);
        // SAFETY: blobs are read-only files that are renamed into place whole and never written or cut again, only
        // unlinked, which leaves the map as it is.
        let map = unsafe { Mmap::map(&file) }.map_err(StoreError::at("map", &path))?;
        Ok(Some(Arc::new(map)))
    }

    /// Puts a file with the content of `digest` in its place, read-only.
    fn keep_blob(&self, temp: Temp, digest: &Digest) -> Result<(), StoreError> {
        let path = self.shelf("cas", digest);
        let sealed = temp.file.set_permissions(Permissions::from_mode(0o444));
        sealed.map_err(StoreError::at("make read-only", &temp.path))?;
        let meta = temp.file.metadata().map_err(StoreError::at("read", &temp.path))?;
        temp.keep(&path)?;
        locked(&self.trusted).insert(*digest, Stamp::of_content(&meta));
        Ok(())
    }
}

/// Writes a blob piece by piece, hashing on the way. Nothing of it is left behind unless [`BlobWriter::finish`]
/// succeeds.
#[derive(Debug)]
pub struct BlobWriter<'s> {
    store: &'s Store,
    temp: Temp,
    hasher: blake3::Hasher,
    gathered: Vec<u8>,
    written: u64,
    expected: u64,
    failed: bool,
}

impl BlobWriter<'_> {
    /// Gives the blob its place in the store, unless it has it already, intact; returns digest and bytes. Fails when
    /// the rest cannot be written or an earlier write failed.
    pub fn finish(mut self) -> Result<(Digest, u64), StoreError> {
        self.pass_gathered()?;
        let digest = Digest(*self.hasher.finalize().as_bytes());
        if self.store.open_blob(&digest, self.written)?.is_none() {
            self.store.keep_blob(self.temp, &digest)?;
        }
        Ok((digest, self.written))
    }

    fn pass_gathered(&mut self) -> Result<(), StoreError> {
        let mut gathered = take(&mut self.gathered);
        let passed = self.pass(&gathered);
        gathered.clear();
        self.gathered = gathered;
        passed
    }

    /// Hashes and writes `bytes`, after those passed before.
    fn pass(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        if self.failed {
            return Err(StoreError::Incomplete { path: self.temp.path.clone() });
        }
        self.hasher.update(bytes);
        self.written += bytes.len() as u64;
        let needed = self.written.max(self.expected);
        let written = self.temp.file.write_all(bytes);
        self.failed = written.is_err();
        written.map_err(StoreError::writing(&self.temp.path, needed))
    }
}

impl Write for BlobWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.gathered.len() + bytes.len() > GATHER {
            self.pass_gathered()?;
        }
        if bytes.len() >= GATHER {
            self.pass(bytes)?;
        } else {
            self.gathered.extend_from_slice(bytes);
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(self.pass_gathered()?)
    }
}

/// When the blob was last asked for: eviction goes by it. Written as the access time, which mount options keep from
/// moving by itself, and which is no part of the content's stamp.
fn note_access(file: &File, meta: &Metadata) {
    let now = SystemTime::now();
    if now.duration_since(last_used(meta)).is_ok_and(|since| since > SAME_ACCESS) {
        // Only the owner may set it; in a cache of somebody else the blob just looks older.
        file.set_times(FileTimes::new().set_accessed(now)).ok();
    }
}

/// The later of the last noted access and the writing of a blob.
pub(super) fn last_used(meta: &Metadata) -> SystemTime {
    let accessed = meta.accessed().unwrap_or(SystemTime::UNIX_EPOCH);
    accessed.max(meta.modified().unwrap_or(SystemTime::UNIX_EPOCH))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{files, open};
    use super::*;
    use std::fs;

    /// Changes the file of a blob behind the back of the store.
    fn tamper(store: &Store, digest: &Digest, change: impl Fn(&mut Vec<u8>)) {
        let path = store.shelf("cas", digest);
        let mut bytes = fs::read(&path).unwrap();
        change(&mut bytes);
        fs::remove_file(&path).unwrap();
        fs::write(&path, bytes).unwrap();
    }

    #[test]
    fn blobs_of_all_sizes_come_back() {
        let (dir, store) = open();
        for size in [0, 1, 4096, GATHER - 1, GATHER, GATHER + 1, 3 * GATHER + 7] {
            let bytes: Vec<u8> = (0..size).map(|at| ((at * at) >> 3) as u8).collect();
            let (digest, count) = store.put_blob(&bytes).unwrap();
            assert_eq!((digest, count), (Digest::of(&bytes), size as u64));
            let again = Store::open(dir.path(), None).unwrap();
            assert_eq!(again.open_blob(&digest, count).unwrap().unwrap()[..], bytes[..]);
            let mode = fs::metadata(store.shelf("cas", &digest)).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o444);

            fs::remove_file(store.shelf("cas", &digest)).unwrap();
            assert!(store.open_blob(&digest, count).unwrap().is_none());
            for piece in [1000, GATHER, 2 * GATHER] {
                let mut writer = store.blob_writer(count).unwrap();
                bytes.chunks(piece).for_each(|part| writer.write_all(part).unwrap());
                assert_eq!(writer.finish().unwrap(), (digest, count));
            }
            assert_eq!(store.open_blob(&digest, count).unwrap().unwrap()[..], bytes[..]);
        }
        assert_eq!(store.damage(), []);
        assert_eq!(files(&store.root.join("tmp")), 0);
    }

    #[test]
    fn a_flipped_bit_is_found_quarantined_reported_and_rebuilt() {
        let (dir, store) = open();
        let (digest, count) = store.put_blob(&[7; 10_000]).unwrap();
        // Also by the store that wrote it: it is no longer the file that it wrote.
        for store in [Store::open(dir.path(), None).unwrap(), store] {
            tamper(&store, &digest, |bytes| bytes[9_000] ^= 4);
            assert!(store.open_blob(&digest, count).unwrap().is_none());
            let damage = store.damage();
            assert_eq!(damage.len(), 1);
            assert_eq!(damage[0].path, store.shelf("cas", &digest));
            assert_eq!(fs::read(damage[0].moved.as_ref().unwrap()).unwrap()[9_000], 3);
            store.put_blob(&[7; 10_000]).unwrap();
            assert_eq!(store.open_blob(&digest, count).unwrap().unwrap()[..], [7; 10_000]);
        }
    }

    #[test]
    fn putting_a_blob_again_heals_a_damaged_one() {
        let (dir, store) = open();
        let (digest, count) = store.put_blob(b"good").unwrap();
        tamper(&store, &digest, |bytes| bytes[0] = b'f');
        let again = Store::open(dir.path(), None).unwrap();
        let mut writer = again.blob_writer(0).unwrap();
        writer.write_all(b"good").unwrap();
        writer.finish().unwrap();
        assert_eq!(again.open_blob(&digest, count).unwrap().unwrap()[..], *b"good");
        assert_eq!(again.damage().len(), 1);
    }

    #[test]
    fn truncated_and_grown_blobs_are_misses() {
        let (_dir, store) = open();
        for size in [0, 1, 4095, 4097] {
            let (digest, count) = store.put_blob(&[1; 4096]).unwrap();
            tamper(&store, &digest, |bytes| bytes.resize(size, 1));
            assert!(store.open_blob(&digest, count).unwrap().is_none());
            assert!(!store.shelf("cas", &digest).exists());
        }
        assert!(store.damage()[0].problem.contains("0 bytes in place of 4096"));
        assert_eq!(store.damage().len(), 4);
    }

    #[test]
    fn a_full_disk_is_named_and_leaves_nothing() {
        let (_dir, store) = open();
        let mut writer = store.blob_writer(5_000_000).unwrap();
        writer.temp.file = File::options().write(true).open("/dev/full").unwrap();
        let error = writer.write_all(&[0; 2 * GATHER]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::StorageFull);
        let text = error.to_string();
        assert!(text.contains("/v1/tmp: 5000000 bytes are needed"), "{text}");
        // The error cannot be passed over by going on.
        assert!(writer.write_all(&[0; 2 * GATHER]).is_err());
        assert!(matches!(writer.finish(), Err(StoreError::Incomplete { .. })));
        assert_eq!(files(&store.root), 0);
    }

    #[test]
    fn an_abandoned_writer_leaves_nothing() {
        let (_dir, store) = open();
        let mut writer = store.blob_writer(0).unwrap();
        writer.write_all(&[0; 2 * GATHER]).unwrap();
        drop(writer);
        assert_eq!(files(&store.root), 0);
    }

    #[test]
    fn an_equal_blob_keeps_its_file_and_an_access_is_noted() {
        let (_dir, store) = open();
        let (digest, count) = store.put_blob(b"same").unwrap();
        let path = store.shelf("cas", &digest);
        let old = SystemTime::now() - Duration::from_secs(5000);
        let times = FileTimes::new().set_modified(old).set_accessed(old);
        File::open(&path).unwrap().set_times(times).unwrap();
        let before = fs::metadata(&path).unwrap();
        let mut writer = store.blob_writer(count).unwrap();
        writer.write_all(b"same").unwrap();
        writer.finish().unwrap();
        let after = fs::metadata(&path).unwrap();
        assert_eq!(Stamp::of_content(&after), Stamp::of_content(&before));
        assert!(last_used(&after) > old + Duration::from_secs(4000));
        assert_eq!(files(&store.root), 1);
    }
}
