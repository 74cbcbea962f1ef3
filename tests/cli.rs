//! The command line as a user meets it: exit codes, messages, JSON.

mod processes;

pub use processes::{reaches, results};

use crate::workspace::{SMALL, Workspace};
use serde_json::Value;
use std::fs;
use std::process::{Command, Output, Stdio};
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

/// How many executions a run computed itself.
pub fn ran(output: &Output) -> u64 {
    json(output)["summary"]["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n["ran"].as_u64().unwrap())
        .sum()
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
