//! What the tests of the store share: a store in a directory of its own, work for threads, and child processes.

use std::env::{current_exe, var};
use std::fs::{self, File, FileTimes};
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

use lightloom_nodes::node::Digest;
use tempfile::TempDir;

use super::{Record, Store, WEEK, key_of};

pub(super) fn open() -> (TempDir, Store) {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::open(dir.path(), None).unwrap();
    (dir, store)
}

pub(super) fn record(manifest: &str, output: &[u8], seconds: f64) -> Record {
    Record {
        manifest: manifest.to_owned(),
        node: "Clusters".to_owned(),
        name: "groups".to_owned(),
        output: Digest::of(output),
        bytes: output.len() as u64,
        seconds,
        cpu_seconds: 0.0,
        alone: true,
        host: String::new(),
        evaluations: 0,
        peak_bytes: 1 << 20,
        made: 1_700_000_000,
        version: "0.1.0".to_owned(),
        notes: vec!["3 normals of length zero".to_owned()],
    }
}

/// A blob of 1000 equal bytes, last used so long ago, with a record when it has a cost.
pub(super) fn put(store: &Store, byte: u8, hours: u64, seconds: Option<f64>) -> Digest {
    let bytes = [byte; 1000];
    let (digest, _) = store.put_blob(&bytes).unwrap();
    if let Some(seconds) = seconds {
        store.put_record(&record(&format!("{byte} {seconds}"), &bytes, seconds)).unwrap();
    }
    let time = SystemTime::now() - Duration::from_secs(hours * 3600);
    let times = FileTimes::new().set_accessed(time).set_modified(time);
    File::open(store.shelf("cas", &digest)).unwrap().set_times(times).unwrap();
    digest
}

/// Files below `dir`.
pub(super) fn files(dir: &Path) -> usize {
    let entries = fs::read_dir(dir).into_iter().flatten().flatten();
    entries.map(|entry| if entry.path().is_dir() { files(&entry.path()) } else { 1 }).sum()
}

pub(super) fn keys(count: usize) -> Vec<String> {
    (0..count).map(|index| format!("Clusters 1\nindex: {index}\n")).collect()
}

/// Asks for every key as the engine does, computing what is missing; each computation adds its key to `log`.
pub(super) fn demand(store: &Store, manifests: &[String], log: &Path) {
    for manifest in manifests {
        let key = key_of(manifest);
        if store.record(&key).is_some() {
            continue;
        }
        let _guard = store.lock_wait(&key, &|| false).unwrap().unwrap();
        if store.record(&key).is_some() {
            continue;
        }
        let mut log = File::options().append(true).create(true).open(log).unwrap();
        log.write_all(format!("{key}\n").as_bytes()).unwrap();
        sleep(Duration::from_millis(1));
        store.put_blob(manifest.as_bytes()).unwrap();
        store.put_record(&record(manifest, manifest.as_bytes(), 1.0)).unwrap();
    }
}

/// Starts `count` processes that play `role` in [`child`] on the cache in `dir`.
pub(super) fn children(count: usize, role: &str, dir: &Path) -> Vec<Child> {
    let module = module_path!().split_once("::").unwrap().1;
    let start = |_| {
        Command::new(current_exe().unwrap())
            .args(["--exact", &format!("{module}::child")])
            .env("STORE_TEST_ROLE", role)
            .env("STORE_TEST_DIR", dir)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    };
    (0..count).map(start).collect()
}

#[test]
fn child() {
    let (Ok(role), Ok(dir)) = (var("STORE_TEST_ROLE"), var("STORE_TEST_DIR")) else { return };
    let store = Store::open(Path::new(&dir), None).unwrap();
    match role.as_str() {
        "demand" => demand(&store, &keys(20), &Path::new(&dir).join("log")),
        "write" => {
            // Ends by itself when its parent died before killing it.
            let start = Instant::now();
            for index in 0_u64.. {
                if start.elapsed() > Duration::from_secs(3) {
                    break;
                }
                let manifest = format!("{} {index}", std::process::id());
                let bytes = index.to_le_bytes().repeat(20_000);
                let _guard = store.lock(&key_of(&manifest)).unwrap().unwrap();
                let mut writer = store.blob_writer(bytes.len() as u64).unwrap();
                writer.write_all(&bytes).unwrap();
                writer.finish().unwrap();
                store.put_record(&record(&manifest, &bytes, 1.0)).unwrap();
            }
        }
        other => panic!("no role {other}"),
    }
}

#[test]
fn an_impossible_directory_is_an_error_with_its_path() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("file"), "").unwrap();
    let error = Store::open(&dir.path().join("file"), None).unwrap_err().to_string();
    assert!(error.contains("file/v1/tmp") && error.contains("move it away"), "{error}");
}

#[test]
fn checkpoints_last_a_week_or_until_dropped() {
    let (dir, store) = open();
    let key = key_of("a");
    store.drop_checkpoint(&key).unwrap();
    for (name, days) in [("a", 6), ("b", 8)] {
        let path = store.checkpoint_path(&key_of(name));
        fs::write(&path, "half").unwrap();
        let time = SystemTime::now() - Duration::from_secs(days * 24 * 3600);
        File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
    }
    let again = Store::open(dir.path(), None).unwrap();
    assert!(again.checkpoint_path(&key).exists());
    assert!(!again.checkpoint_path(&key_of("b")).exists());
    again.drop_checkpoint(&key).unwrap();
    assert!(!again.checkpoint_path(&key).exists());
}

#[test]
fn the_quarantine_lasts_a_week_and_leaves_foreign_files() {
    let (dir, store) = open();
    let (digest, _) = store.put_blob(b"blob").unwrap();
    let old = File::open(store.shelf("cas", &digest)).unwrap();
    old.set_modified(SystemTime::now() - 2 * WEEK).unwrap();
    store.quarantine("cas", &digest, "looked at".to_owned());
    let kept = store.damage()[0].moved.clone().unwrap();
    let foreign = kept.with_file_name("notes.txt");
    fs::write(&foreign, "mine").unwrap();
    Store::open(dir.path(), None).unwrap();
    assert!(kept.exists(), "the week counts from the finding");
    for path in [&kept, &foreign] {
        File::open(path).unwrap().set_modified(SystemTime::now() - 2 * WEEK).unwrap();
    }
    Store::open(dir.path(), None).unwrap();
    assert!(!kept.exists() && foreign.exists());
}
