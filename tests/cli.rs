//! The command line as a user meets it: exit codes, messages, JSON, interruption.

use crate::workspace::{SMALL, Workspace};
use lightloom::store::Store;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

pub fn lightloom(project: &Workspace) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightloom"));
    command.current_dir(project.path("")).env_remove("LIGHTLOOM_CACHE").stdin(Stdio::null());
    command
}

/// Runs a command in the project folder.
pub fn ask(project: &Workspace, arguments: &[&str]) -> Output {
    lightloom(project).args(arguments).output().unwrap()
}

/// `run` with the overrides of the small shot and more arguments.
fn small(project: &Workspace, arguments: &[&str]) -> Command {
    let mut command = lightloom(project);
    command
        .args(["run", "graph.ron"])
        .args(SMALL.iter().flat_map(|set| ["--set", set]))
        .args(arguments);
    command
}

pub fn code(output: &Output) -> i32 {
    output.status.code().unwrap()
}

pub fn errors(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// The one JSON document on the output stream.
pub fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| {
        panic!("{e} in {:?}, errors {:?}", String::from_utf8_lossy(&output.stdout), errors(output))
    })
}

/// A picture that takes no time.
const STILL: &str = r#"Graph(
    vars: { "rough": 0.3 },
    nodes: {
        "scene": Pavilion(detail: 0.2),
        "geometry": Geometry(scene: "scene"),
        "materials": Materials(scene: "scene"),
        "poses": Poses(scene: "scene"),
        "camera": Camera(scene: "scene"),
        "sun": SunLights(),
        "framebuffer": DeepFramebuffer(geometry: "geometry", materials: "materials", poses: "poses", camera: "camera", size: (8, 8), min_roughness: "$rough"),
        "image": Reference(framebuffer: "framebuffer", lights: "sun", geometry: "geometry", materials: "materials", poses: "poses"),
        "png": Png(image: "image"),
    },
    outputs: { "picture": "png" },
)
"#;

fn still() -> Workspace {
    Workspace::new(STILL)
}

#[test]
fn a_run_says_what_it_did() {
    let project = still();
    let first = json(&ask(&project, &["run", "graph.ron", "--json"]));
    let nodes = first["summary"]["nodes"].as_array().unwrap();
    assert_eq!((first["ok"].as_bool(), nodes.len()), (Some(true), 9));
    assert!(nodes.iter().all(|n| n["ran"] == 1 && n["executions"] == 1), "{first}");
    let picture = project.path(first["published"][0]["path"].as_str().unwrap());
    assert_eq!(&fs::read(picture).unwrap()[..8], b"\x89PNG\r\n\x1a\n");
    let again = ask(&project, &["run", "graph.ron"]);
    assert_eq!(code(&again), 0);
    let text = String::from_utf8(again.stdout).unwrap();
    assert!(text.contains("0 of 9 executions ran, 9 reused"), "{text}");
}

#[test]
fn a_good_graph_is_checked() {
    let project = still();
    assert_eq!(code(&ask(&project, &["check", "graph.ron"])), 0);
    let checked = json(&ask(&project, &["check", "graph.ron", "--json"]));
    assert_eq!(
        (&checked["ok"], &checked["nodes"], &checked["variables"]),
        (&true.into(), &9.into(), &1.into())
    );
    assert!(!project.path(".lightloom").exists(), "a check leaves no cache behind");
}

#[test]
fn every_mistake_is_told_with_its_place() {
    let project = still();
    project.edit("Materials(scene: \"scene\")", "Materiel(scene: \"scene\")");
    project.edit("lights: \"sun\"", "lights: \"moon\"");
    project.edit("detail: 0.2", "detail: \"fine\"");
    for command in ["check", "run", "plan"] {
        let wrong = ask(&project, &[command, "graph.ron"]);
        let text = errors(&wrong);
        assert_eq!(code(&wrong), 2, "{command}");
        for place in ["graph.ron:4:35", "graph.ron:6:22", "Materials", "moon"] {
            assert!(text.contains(place), "{command}: {place} is not in {text}");
        }
        let told = json(&ask(&project, &[command, "graph.ron", "--json"]));
        assert_eq!((&told["ok"], &told["exit_code"]), (&false.into(), &2.into()));
        let lines: Vec<u64> = told["errors"]
            .as_array()
            .unwrap()
            .iter()
            .map(|e| e["line"].as_u64().unwrap())
            .collect();
        assert_eq!(lines, [4, 6, 11], "{told}");
        assert!(
            told["errors"]
                .as_array()
                .unwrap()
                .iter()
                .all(|e| e["file"] == "graph.ron" && e["column"].as_u64() > Some(1))
        );
    }
}

#[test]
fn a_graph_that_is_no_graph_is_refused() {
    let project = still();
    for (text, place) in
        [("", "graph.ron:1:1"), ("Graph(nodes: {", "graph.ron:1:"), ("\u{fffd}{{", "graph.ron:1:1")]
    {
        project.write("graph.ron", text);
        let wrong = ask(&project, &["run", "graph.ron"]);
        assert!(
            code(&wrong) == 2 && errors(&wrong).contains(place),
            "{text:?}: {}",
            errors(&wrong)
        );
    }
    fs::write(project.path("graph.ron"), [0xff, 0xfe, 0x00]).unwrap();
    assert_eq!(code(&ask(&project, &["run", "graph.ron"])), 2);
    let gone = ask(&project, &["run", "gone.ron"]);
    assert!(code(&gone) == 2 && errors(&gone).contains("gone.ron"), "{}", errors(&gone));
    assert_eq!(json(&ask(&project, &["run", "gone.ron", "--json"]))["exit_code"], 2);
    assert_eq!(code(&ask(&project, &["run"])), 2);
    assert_eq!(code(&ask(&project, &["dance", "graph.ron"])), 2);
}

#[test]
fn what_matches_nothing_is_exit_code_3() {
    let project = still();
    let unknown = ask(&project, &["explain", "graph.ron", "imag"]);
    assert!(code(&unknown) == 3 && errors(&unknown).contains("`image`"), "{}", errors(&unknown));
    assert_eq!(json(&ask(&project, &["explain", "graph.ron", "imag", "--json"]))["exit_code"], 3);
    project.edit("outputs: { \"picture\": \"png\" },", "");
    let nothing = ask(&project, &["run", "graph.ron"]);
    assert!(code(&nothing) == 3 && errors(&nothing).contains("outputs"), "{}", errors(&nothing));
}

#[test]
fn overrides_that_do_not_fit_are_told() {
    let project = still();
    for (set, part) in [
        ("rugh=0.5", "`rugh`"),
        ("rough", "no `=`"),
        ("rough=", "both sides"),
        ("rough=(1", "not closed"),
        ("rough=7", "0.0..=1.0"),
        ("rough=wild", "number"),
        ("imag.seed=2", "\"imag\""),
        ("framebuffer.sise=(9, 9)", "`sise`"),
        ("image.lights=moon", "moon"),
    ] {
        let wrong = ask(&project, &["run", "graph.ron", "--set", set]);
        assert!(code(&wrong) == 2 && errors(&wrong).contains(part), "{set}: {}", errors(&wrong));
        let told = json(&ask(&project, &["check", "graph.ron", "--json", "--set", set]));
        assert_eq!(told["exit_code"], 2, "{set}");
    }
    assert_eq!(
        code(&ask(
            &project,
            &["run", "graph.ron", "--set", "rough=0.5", "--set", "framebuffer.size=(4, 4)"]
        )),
        0
    );
}

#[test]
fn a_missing_scene_is_named() {
    let project = still();
    project.edit("Pavilion(detail: 0.2)", "Scene(file: \"scenes/gone.glb\")");
    let missing = ask(&project, &["run", "graph.ron"]);
    assert_eq!(code(&missing), 1);
    let text = errors(&missing);
    assert!(text.contains("scenes/gone.glb") && text.contains("scene (Scene)"), "{text}");
    let told = json(&ask(&project, &["run", "graph.ron", "--json"]));
    assert_eq!((&told["ok"], &told["exit_code"]), (&false.into(), &1.into()));
    assert!(told["errors"][0]["message"].as_str().unwrap().contains("scenes/gone.glb"));

    fs::create_dir(project.path("scenes")).unwrap();
    project.write("scenes/gone.glb", "glTF but not really");
    let broken = ask(&project, &["run", "graph.ron"]);
    assert!(
        code(&broken) == 1 && errors(&broken).contains("scenes/gone.glb"),
        "{}",
        errors(&broken)
    );
}

#[test]
fn folders_that_cannot_be_written_are_named() {
    let project = still();
    let out = ask(&project, &["run", "graph.ron", "--out", "graph.ron/pictures"]);
    assert!(code(&out) == 1 && errors(&out).contains("graph.ron/pictures"), "{}", errors(&out));
    let out = ask(&project, &["run", "graph.ron", "--out", "graph.ron", "--json"]);
    assert_eq!((code(&out), &json(&out)["exit_code"]), (1, &1.into()));
    // Nothing is lost: the results are in the cache.
    let again = ask(&project, &["run", "graph.ron", "--json"]);
    assert_eq!(ran(&again), 0);

    let cache = ask(&project, &["run", "graph.ron", "--cache", "graph.ron"]);
    let text = errors(&cache);
    assert!(
        code(&cache) == 1 && text.contains("graph.ron") && text.contains("a file is in the place"),
        "{text}"
    );
    assert_eq!(
        json(&ask(&project, &["run", "graph.ron", "--cache", "graph.ron", "--json"]))["exit_code"],
        1
    );
}

#[test]
fn a_run_without_changes_takes_less_than_a_second() {
    let project = Workspace::of("tensor.ron");
    assert!(small(&project, &["--json"]).output().unwrap().status.success());
    let time = || {
        let started = Instant::now();
        let output = small(&project, &["--json"]).output().unwrap();
        assert_eq!(ran(&output), 0);
        started.elapsed()
    };
    let best = (0..3).map(|_| time()).min().unwrap();
    assert!(best < Duration::from_secs(1), "{best:?}");
}

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

/// How many executions a run computed itself.
pub fn ran(output: &Output) -> u64 {
    json(output)["summary"]["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n["ran"].as_u64().unwrap())
        .sum()
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
