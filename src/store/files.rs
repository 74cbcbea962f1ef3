//! Digests of input files, remembered by what the file system says about them, so that a large scene is read once.

use std::fs::{self, File, Metadata};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, SystemTime};

use lightloom_nodes::node::Digest;

use super::digest::{seal, unseal};
use super::{Store, StoreError};

/// A file changed so shortly ago may change again without a visible change of its times (the racy-git rule).
const SETTLED: Duration = Duration::from_secs(2);

/// What tells one state of a file from another without reading it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamp {
    dev: u64,
    ino: u64,
    pub(super) size: u64,
    mtime: (i64, i64),
    ctime: (i64, i64),
}

impl Stamp {
    pub(super) fn of(meta: &Metadata) -> Self {
        Self {
            dev: meta.dev(),
            ino: meta.ino(),
            size: meta.size(),
            mtime: (meta.mtime(), meta.mtime_nsec()),
            ctime: (meta.ctime(), meta.ctime_nsec()),
        }
    }

    /// The stamp without the time of the last change of the inode, which noting an access moves.
    pub(super) fn of_content(meta: &Metadata) -> Self {
        Self { ctime: (0, 0), ..Self::of(meta) }
    }
}

/// The BLAKE3 digest of what is left to read in `file`. Read, not mapped: a bad sector or a file that shrinks meanwhile
/// is then an error, not a signal.
pub(super) fn digest_of(file: &File) -> io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(file)?;
    Ok(Digest(*hasher.finalize().as_bytes()))
}

impl Store {
    /// The BLAKE3 digest of the content of the regular file at `path`. It is remembered under device, inode, size and
    /// times, unless the file was modified in the last two seconds. Fails when the file cannot be read, or changes
    /// each time it is read.
    pub fn file_digest(&self, path: &Path) -> Result<Digest, StoreError> {
        // Asked before opening: opening a pipe would wait for its other end.
        if !fs::metadata(path).map_err(StoreError::at("read", path))?.is_file() {
            return Err(StoreError::at("read", path)(io::ErrorKind::InvalidInput.into()));
        }
        for _ in 0..3 {
            let file = File::open(path).map_err(StoreError::at("read", path))?;
            let meta = file.metadata().map_err(StoreError::at("read", path))?;
            let stamp = Stamp::of(&meta);
            if let Some(digest) = self.remembered(&stamp) {
                return Ok(digest);
            }
            let digest = digest_of(&file).map_err(StoreError::at("read", path))?;
            let after = file.metadata().map_err(StoreError::at("read", path))?;
            if Stamp::of(&after) == stamp {
                self.remember(&stamp, &meta, digest);
                return Ok(digest);
            }
        }
        Err(StoreError::Changing { path: path.to_owned() })
    }

    fn remembered(&self, stamp: &Stamp) -> Option<Digest> {
        let line = format!("{stamp:?}");
        let sealed = fs::read(self.shelf("stat", &Digest::of(line.as_bytes()))).ok()?;
        unseal(&sealed)?.strip_prefix(&line)?.trim_start().parse().ok()
    }

    fn remember(&self, stamp: &Stamp, meta: &Metadata, digest: Digest) {
        let age = meta.modified().ok().and_then(|time| SystemTime::now().duration_since(time).ok());
        if age.is_none_or(|age| age < SETTLED) {
            return;
        }
        let line = format!("{stamp:?}");
        let path = self.shelf("stat", &Digest::of(line.as_bytes()));
        // A memo that cannot be written costs time only: the digest is known all the same.
        self.put_text(&path, &seal(&format!("{line}\n{digest}"))).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{files, open};
    use super::*;

    fn aged(path: &Path, seconds: u64) {
        let time = SystemTime::now() - Duration::from_secs(seconds);
        File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
    }

    #[test]
    fn a_settled_file_is_remembered_and_a_fresh_one_is_not() {
        let (dir, store) = open();
        let path = dir.path().join("scene.glb");
        fs::write(&path, "scene").unwrap();
        assert_eq!(store.file_digest(&path).unwrap(), Digest::of(b"scene"));
        assert_eq!(files(&store.root.join("stat")), 0);
        aged(&path, 10);
        assert_eq!(store.file_digest(&path).unwrap(), Digest::of(b"scene"));
        assert_eq!(files(&store.root.join("stat")), 1);

        // The memo is what answers: with another digest in it, that one comes back.
        let stamp = Stamp::of(&fs::metadata(&path).unwrap());
        store.remember(&stamp, &fs::metadata(&path).unwrap(), Digest::of(b"memo"));
        assert_eq!(store.file_digest(&path).unwrap(), Digest::of(b"memo"));
    }

    #[test]
    fn a_change_of_equal_length_with_its_time_set_back_is_seen() {
        let (dir, store) = open();
        let path = dir.path().join("scene.glb");
        fs::write(&path, "scene").unwrap();
        aged(&path, 10);
        let time = fs::metadata(&path).unwrap().modified().unwrap();
        assert_eq!(store.file_digest(&path).unwrap(), Digest::of(b"scene"));
        fs::write(&path, "SCENE").unwrap();
        File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
        assert_eq!(store.file_digest(&path).unwrap(), Digest::of(b"SCENE"));
    }

    #[test]
    fn a_damaged_memo_is_not_believed() {
        let (dir, store) = open();
        let path = dir.path().join("scene.glb");
        fs::write(&path, "scene").unwrap();
        aged(&path, 10);
        store.file_digest(&path).unwrap();
        let line = format!("{:?}", Stamp::of(&fs::metadata(&path).unwrap()));
        fs::write(store.shelf("stat", &Digest::of(line.as_bytes())), "").unwrap();
        assert_eq!(store.file_digest(&path).unwrap(), Digest::of(b"scene"));
    }

    #[test]
    fn what_is_no_file_is_an_error_with_its_path() {
        let (dir, store) = open();
        let missing = store.file_digest(&dir.path().join("none.glb")).unwrap_err().to_string();
        assert!(missing.contains("none.glb"), "{missing}");
        let folder = store.file_digest(dir.path()).unwrap_err().to_string();
        assert!(folder.contains("name a regular file"), "{folder}");
    }
}
