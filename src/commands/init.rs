//! `init`: the graph that a scene requires, with a comment on each choice. What a scene does not
//! need is not in its graph.

mod choices;
#[cfg(test)]
mod fixtures;
mod needs;
mod paths;
mod shot;
mod template;

use super::Common;
use super::output::{say, say_json};
use super::session::{Failure, print_diagnostics};
use crate::graph::Graph;
use crate::registry::Registry;
use lightloom_nodes as nodes;
use needs::Needs;
use nodes::node::{Ctx, Error, File, Node};
use paths::quoted;
use shot::Shot;
use std::io::Write as _;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Init {
    /// The scene, a .gltf or .glb file.
    scene: PathBuf,
    /// Puts a ground under the scene.
    #[arg(long)]
    ground: bool,
    /// Lights the scene with an .exr or .hdr latitude-longitude map.
    #[arg(long, value_name = "MAP")]
    environment: Option<PathBuf>,
    /// Turns the camera around the scene by this angle.
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = angle)]
    orbit: Option<f32>,
    /// Bounces light between points (2012) in place of sampling a lighting matrix.
    #[arg(long)]
    points: bool,
    /// Frames of the shot: 40 by default where something moves, else 1.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
    /// Size of the picture, pixels.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = size)]
    size: [u32; 2],
    /// The graph file to write; named after the scene and in the current folder by default.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replaces a file that exists.
    #[arg(long)]
    force: bool,
}

fn angle(text: &str) -> Result<f32, String> {
    let degrees: f32 = text.parse().map_err(|_| "expected degrees")?;
    let turns = degrees != 0.0 && degrees.abs() <= 36_000.0;
    turns.then_some(degrees).ok_or_else(|| "expected degrees from -36000 to 36000, not 0".into())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let number = |text: &str| text.parse().ok().filter(|n| (1..=16_384).contains(n));
    let both = text.split_once('x').and_then(|(w, h)| Some([number(w)?, number(h)?]));
    both.ok_or_else(|| "expected width x height, each 1 to 16384, as in 640x360".into())
}

impl Init {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let out = self.out.clone().unwrap_or_else(|| {
            let mut name = self.scene.file_stem().unwrap_or(self.scene.as_os_str()).to_owned();
            name.push(".ron");
            name.into()
        });
        if !self.force && out.exists() {
            return Err(exists(&out));
        }
        let ctx = Ctx::default();
        let wrong = |e: Error| match e {
            Error::Invalid(what) => Failure::Usage(format!("{}: {what}", self.scene.display())),
            other => Failure::Usage(other.to_string()),
        };
        let scene = nodes::Scene { file: File(self.scene.clone()), clip: 0 }
            .run((), &ctx)
            .map_err(wrong)?;
        let needs = Needs::of(scene, &ctx).map_err(wrong)?;
        if let Some(map) = &self.environment {
            // A map that cannot be read is told now, not by the first run.
            let map = nodes::EnvironmentMap { file: File(map.clone()), ..Default::default() };
            map.run((), &ctx).map_err(|e| Failure::Usage(e.to_string()))?;
        }
        let shot = Shot::new(self, &needs)?;
        let folder = out.parent().unwrap_or(Path::new(""));
        let mut files = vec![quoted(folder, &self.scene)?];
        files.extend(self.environment.as_ref().map(|map| quoted(folder, map)).transpose()?);
        let text = self.graph(&needs, &shot, &files, &out);
        let graph = Graph::read(&text, &out.display().to_string(), folder, registry, &[])
            .map_err(Failure::Graph)?;
        write(&out, &text, self.force)?;
        let (count, frames) = (graph.nodes.len(), shot.frames);
        if common.json {
            let notes = ctx.notes();
            let report = serde_json::json!({ "ok": true, "graph": out, "nodes": count, "frames": frames, "notes": notes });
            return say_json(&report);
        }
        print_diagnostics(&graph.warnings);
        ctx.notes().iter().for_each(|note| eprintln!("note: {note}"));
        let what = if frames == 1 { "a still".to_owned() } else { format!("{frames} frames") };
        say(format_args!(
            "{}: {what}, {count} nodes; `lightloom run {0}` renders it\n",
            out.display()
        ))
    }
}

fn exists(out: &Path) -> Failure {
    Failure::Usage(format!(
        "{} exists; --force replaces it, --out FILE writes another",
        out.display()
    ))
}

fn write(out: &Path, text: &str, force: bool) -> Result<(), Failure> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true);
    if force {
        options.create(true).truncate(true)
    } else {
        options.create_new(true)
    };
    let written = options.open(out).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => exists(out),
        _ => Failure::Usage(format!("{}: cannot be written: {e}", out.display())),
    })
}

#[cfg(test)]
mod tests {
    use super::fixtures::init;
    use super::*;
    use std::fs;

    const TRIANGLE: &str = r#"{ "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [ { "type": "point", "intensity": 9000 } ] } },
        "buffers": [{ "byteLength": 36, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] }],
        "materials": [{ "doubleSided": true, "emissiveFactor": [1, 0, 0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "nodes": [{ "mesh": 0 }, { "extensions": { "KHR_lights_punctual": { "light": 0 } } }],
        "scenes": [{ "nodes": [0, 1] }], "scene": 0 }"#;

    #[test]
    fn a_file_becomes_a_graph_once() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("triangle.gltf");
        fs::write(&scene, TRIANGLE).unwrap();
        let common = Common { json: true, cache: folder.path().into(), quota: Some(1.0) };
        let run = |init: &Init| match init.run(&common, &Registry::builtin()) {
            Ok(()) => String::new(),
            Err(Failure::Usage(what)) => what,
            Err(_) => panic!("not a mistake of usage"),
        };
        let out = folder.path().join("graphs/made.ron");
        let mut init = init(&scene);
        init.out = Some(out.clone());
        assert!(run(&init).contains("cannot be written"));
        fs::create_dir(folder.path().join("graphs")).unwrap();
        assert_eq!(run(&init), "");
        let text = fs::read_to_string(&out).unwrap();
        assert!(text.contains("Scene(file: \"../triangle.gltf\")"), "{text}");
        assert!(
            text.contains("1 points") && text.contains("1 triangles emit: 1.0000 square metres"),
            "{text}"
        );
        assert!(text.contains("sides: both") && text.contains("exposure: -11"), "{text}");
        assert!(run(&init).contains("--force"));
        init.force = true;
        assert_eq!(run(&init), "");
        init.frames = Some(2);
        assert!(run(&init).contains("nothing moves"));
        init.frames = None;
        init.environment = Some("nowhere.hdr".into());
        assert!(run(&init).contains("nowhere.hdr"));
        init.scene = "nowhere.glb".into();
        assert!(run(&init).contains("nowhere.glb"));
        assert_eq!(fs::read_to_string(&out).unwrap(), text);
    }

    #[test]
    fn sizes_and_angles() {
        assert_eq!((size("640x360"), angle("-90")), (Ok([640, 360]), Ok(-90.0)));
        assert!(["640", "0x1", "1x16385", "1x1x1"].iter().all(|text| size(text).is_err()));
        assert!(["0", "NaN", "inf", "1e9", "x"].iter().all(|text| angle(text).is_err()));
    }
}
