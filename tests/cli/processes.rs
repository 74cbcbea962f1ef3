//! Threads, processes and interruptions: whatever happens to a run, its results are the same.

use super::{ask, code, errors, json, lightloom, ran, small};
use crate::workspace::Workspace;
use lightloom::store::Store;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// The digest of what every action in a cache gave, by its description.
pub fn results(cache: &Path) -> BTreeMap<String, String> {
    let store = Store::open(cache, None).unwrap();
    store.records().map(|(_, record)| (record.manifest, record.output.to_string())).collect()
}

/// Every published file with its content.
fn published(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let visible = entries.filter(|e| !e.file_name().to_string_lossy().starts_with('.'));
    visible.map(|e| (e.file_name().into_string().unwrap(), fs::read(e.path()).unwrap())).collect()
}

#[test]
fn threads_and_jobs_do_not_change_a_bit() {
    let project = Workspace::of("tensor.ron");
    let run = |threads: &str, jobs: &str| {
        let cache = format!("cache-{threads}-{jobs}");
        let mut command =
            small(&project, &["--threads", threads, "--jobs", jobs, "--cache", &cache, "--json"]);
        assert!(command.output().unwrap().status.success());
        results(&project.path(&cache))
    };
    let one = run("1", "1");
    assert!(one.len() > 60, "{} results", one.len());
    for (threads, jobs) in [("2", "1"), ("1", "2"), ("2", "2")] {
        let other = run(threads, jobs);
        let differ: Vec<&String> =
            one.iter().filter(|(k, v)| other.get(*k) != Some(v)).map(|(k, _)| k).collect();
        assert!(
            differ.is_empty() && one.len() == other.len(),
            "{threads} threads, {jobs} jobs: {differ:?}"
        );
    }
}

#[test]
fn two_processes_on_one_cache_share_the_work() {
    let project = Workspace::of("tensor.ron");
    let start = |out| {
        let mut command = small(&project, &["--json", "--out", out]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let outputs = [start("one"), start("two")].map(|child| child.wait_with_output().unwrap());
    outputs.iter().for_each(|o| assert_eq!((code(o), errors(o)), (0, String::new())));
    // Every action is recorded once and was computed once; the frames and the reconstruction are one
    // of four items each.
    let [one, two] = outputs.each_ref().map(ran);
    assert_eq!(one + two + 3 + 3, records(&project.path(".lightloom")) as u64);
    assert!(published(&project.path("one")) == published(&project.path("two")));
}

/// How many actions a cache has recorded.
fn records(cache: &Path) -> usize {
    let shelves = fs::read_dir(cache.join("v1/ac")).into_iter().flatten().flatten();
    shelves.flat_map(|shelf| fs::read_dir(shelf.path()).into_iter().flatten()).count()
}

/// Waits until a run has recorded `count` actions; false when it ended before.
pub fn reaches(child: &mut Child, cache: &Path, count: usize) -> bool {
    let end = Instant::now() + Duration::from_secs(60);
    while records(cache) < count {
        assert!(Instant::now() < end, "the run does not get to {count} results");
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        sleep(Duration::from_millis(2));
    }
    true
}

#[test]
fn a_run_that_is_killed_five_times_ends_with_the_same_results() {
    let project = Workspace::of("tensor.ron");
    assert!(
        small(&project, &["--cache", "whole", "--out", "out-whole", "--json"])
            .output()
            .unwrap()
            .status
            .success()
    );
    let cache = project.path("killed");
    for (round, count) in [3, 14, 27, 41, 52].into_iter().enumerate() {
        let mut command = small(&project, &["--cache", "killed", "--out", "out-killed", "--json"]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        assert!(reaches(&mut child, &cache, count), "the run ended before it was killed");
        // Not always at the same moment of an action.
        sleep(Duration::from_millis(round as u64));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let recorded = || Store::open(&cache, None).unwrap().records().collect::<BTreeMap<_, _>>();
    let before = recorded();
    let last =
        small(&project, &["--cache", "killed", "--out", "out-killed", "--json"]).output().unwrap();
    assert!(last.status.success() && errors(&last).is_empty(), "{}", errors(&last));
    // A record holds the seconds that its action took: one that is made again is another one. Those of
    // several items may have been killed between two of them.
    let after = recorded();
    let single =
        before.iter().filter(|(_, record)| !["Frames", "Reconstruct"].contains(&&*record.node));
    assert!(before.len() >= 50 && ran(&last) > 0, "{} results were kept", before.len());
    single.for_each(|(key, record)| assert_eq!(after.get(key), Some(record)));
    assert!(results(&cache) == results(&project.path("whole")));
    assert!(published(&project.path("out-killed")) == published(&project.path("out-whole")));
    assert_eq!(
        fs::read_dir(cache.join("v1/tmp")).unwrap().count(),
        0,
        "what killed runs left is removed"
    );
}

#[test]
fn an_interrupted_run_is_exit_code_4_and_goes_on() {
    let project = Workspace::of("reference.ron");
    let sets =
        ["still=0", "lights=2000", "sky_lights.count=256", "samples.count=800", "scene.detail=0.3"];
    let sets = sets.iter().flat_map(|set| ["--set", set]);
    let mut command = lightloom(&project);
    command
        .args(["run", "graph.ron", "--json"])
        .args(sets.clone())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let cache = project.path(".lightloom");
    assert!(reaches(&mut child, &cache, 30), "the run ended before it was interrupted");
    let Ok(status) = Command::new("kill").args(["-INT", &child.id().to_string()]).status() else {
        eprintln!("skipped: there is no `kill` command");
        child.kill().unwrap();
        child.wait().unwrap();
        return;
    };
    assert!(status.success());
    let asked = Instant::now();
    let output = child.wait_with_output().unwrap();
    assert!(asked.elapsed() < Duration::from_secs(5), "it took {:?} to stop", asked.elapsed());
    assert_eq!((code(&output), &json(&output)["exit_code"]), (4, &4.into()), "{}", errors(&output));
    assert!(errors(&output).contains("finished results are kept"), "{}", errors(&output));

    // What was finished is not run again.
    let first: Vec<&str> =
        ["run", "graph.ron", "--json", "--set", "last=0", "--set", "size=(32, 18)"]
            .into_iter()
            .chain(sets)
            .collect();
    let rest = json(&ask(&project, &first));
    let ran: Vec<&Value> =
        rest["summary"]["nodes"].as_array().unwrap().iter().filter(|n| n["ran"] != 0).collect();
    assert!(!ran.iter().any(|n| n["name"] == "geometry" || n["name"] == "samples"), "{ran:?}");
}
