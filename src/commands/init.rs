//! `init`: the graph that a scene requires, with a comment on each choice. What a scene does not
//! need is not in its graph.

mod needs;
mod paths;
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
use std::io::Write as _;
use std::path::{Path, PathBuf};
use template::fill;

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

/// The frames to render.
struct Shot {
    frames: u32,
    fps: f64,
    orbit: Option<f32>,
}

impl Shot {
    fn new(init: &Init, needs: &Needs) -> Result<Shot, Failure> {
        let moves = needs.moves() || init.orbit.is_some();
        let frames = init.frames.unwrap_or(if moves { 40 } else { 1 });
        if frames > 1 && !moves {
            let what = format!(
                "--frames {frames}: nothing moves in this scene; --orbit DEGREES turns its camera"
            );
            return Err(Failure::Usage(what));
        }
        if frames == 1 && init.orbit.is_some() {
            return Err(Failure::Usage(
                "--orbit turns the camera over a shot: it needs more than 1 frame".into(),
            ));
        }
        let seconds = if needs.moves() && needs.seconds > 0.0 { needs.seconds } else { 2.0 };
        // Thousandths are what a person would write; the limits are those of `Apng`.
        let fps = ((f64::from(frames) / seconds * 1e3).round() / 1e3).clamp(0.01, 1000.0);
        Ok(Shot { frames, fps, orbit: init.orbit })
    }
}

/// Lights of an environment and of emissive surfaces where bounces go by points: they are summed for each point and pixel.
const BY_POINTS: [usize; 2] = [256, 512];
/// Lights in all, of an environment, and on the sun's disc (Hašan et al. 2008, section 5).
const LIGHTS: [usize; 3] = [65_536, 16_384, 16];

impl Init {
    /// The text of the graph; `files` are the scene and the map as they stand in it.
    fn graph(&self, n: &Needs, shot: &Shot, files: &[String], out: &Path) -> String {
        let moving = shot.frames > 1;
        let (posed, punctual) = (moving && n.shapes_move(), n.punctual() > 0);
        let (map, emissive) = (files.len() > 1, n.emissive.0 > 0);
        let sky = !(map || punctual || emissive);
        let (around, own) = (map || sky, n.cameras.0 > 0);
        let lights_only = moving && !(posed || n.cameras.1 || shot.orbit.is_some());
        let subject = self.ground && (!own || shot.orbit.is_some());
        let few = if punctual { "punctual" } else { "sun" };
        let lamps: Vec<&str> = [(few, punctual || sky), ("emissive", emissive)]
            .into_iter()
            .filter_map(|(name, is)| is.then_some(name))
            .collect();
        let has = [
            ("points", self.points),
            ("lamps", !lamps.is_empty()),
            ("shot", moving),
            ("moves", n.moves()),
            ("posed", posed),
            ("ground", self.ground),
            ("masked", n.materials[1] > 0),
            ("two_sided", n.materials[0] > 0),
            ("subject", subject),
            ("lights_only", lights_only),
            ("camera", own),
            ("orbit", shot.orbit.is_some()),
            ("punctual", punctual),
            ("sky", sky),
            ("map", map),
            ("around", around),
            ("emissive", emissive),
            ("bright", n.stops < 0 && !map),
        ];
        let emitters = match () {
            () if !emissive => 0,
            () if self.points => BY_POINTS[1],
            () if n.emissive.1 < 0.01 * n.diagonal * n.diagonal => 4096,
            () => 8192,
        };
        let mut all = Vec::new();
        for (name, is) in
            [(few, punctual || sky), ("environment_lights", around), ("emissive", emissive)]
        {
            all.extend(is.then_some(name));
        }
        let many =
            if around && emissive { "many" } else { all.last().copied().unwrap_or_default() };
        if !self.points {
            all.push("bounce");
        }
        let others = n.punctual()
            + emitters
            + if sky { LIGHTS[2] } else { 0 }
            + if around { LIGHTS[1] } else { 0 };
        let port = |is: bool, name: &str, to: &str| {
            if is { format!(", {name}: {to:?}") } else { String::new() }
        };
        let time = |moves: bool| port(moving && moves, "time", "frames");
        let values = [
            ("name", file_name(&self.scene)),
            ("out", file_name(out)),
            ("triangles", n.triangles.to_string()),
            ("across", format!("{:.4}", n.diagonal)),
            ("size", format!("({}, {})", self.size[0], self.size[1])),
            ("total", LIGHTS[0].to_string()),
            ("fps", shot.fps.to_string()),
            ("last", (shot.frames - 1).to_string()),
            ("seconds", format!("{:.4}", f64::from(shot.frames) / shot.fps)),
            (
                "exposure",
                if sky {
                    -1
                } else if map {
                    0
                } else {
                    n.stops
                }
                .to_string(),
            ),
            ("degrees", shot.orbit.unwrap_or_default().to_string()),
            ("file", if self.ground { "file" } else { "scene" }.into()),
            ("scene", files[0].clone()),
            ("map", files.last().cloned().unwrap_or_default()),
            ("masked", n.materials[1].to_string()),
            ("two_sided", n.materials[0].to_string()),
            ("sides", if n.materials[0] > 0 { "both" } else { "front" }.into()),
            ("rigid", n.instances[0].to_string()),
            ("deforming", n.instances[1].to_string()),
            ("cameras", n.cameras.0.to_string()),
            ("own_camera", if shot.orbit.is_some() { "own_camera" } else { "camera" }.into()),
            ("subject", if subject { "subject" } else { "geometry" }.into()),
            ("poses_time", time(posed)),
            ("camera_time", time(n.cameras.1 || lights_only)),
            ("lights_time", time(n.lights.1)),
            ("points", n.lights.0[0].to_string()),
            ("spots", n.lights.0[1].to_string()),
            ("directional", n.lights.0[2].to_string()),
            ("around", if self.points { BY_POINTS[0] } else { LIGHTS[1] }.to_string()),
            ("lamps", format!("{lamps:?}")),
            ("lamps_port", port(!lamps.is_empty(), "lights", "lamps")),
            ("emissive", n.emissive.0.to_string()),
            ("area", format!("{:.4}", n.emissive.1)),
            ("power", format!("{:.4}", n.emissive.2)),
            ("emitters", emitters.to_string()),
            ("at", r#"geometry: "geometry", materials: "materials", poses: "poses""#.into()),
            ("rest", if posed { "rest" } else { "poses" }.into()),
            ("emissive_rest", port(posed, "rest", "rest")),
            ("direct", port(punctual || sky, "direct", few)),
            ("many", port(around || emissive, "area", many)),
            ("samples", LIGHTS[0].saturating_sub(others).max(1024).to_string()),
            ("all", format!("{all:?}")),
            ("background", port(around, "environment", "environment")),
            ("maps", port(moving, "maps", "maps")),
        ];
        fill(&has, &values)
    }
}

/// A file's name, for comments: on one line whatever it is.
fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str());
    name.to_string_lossy().escape_debug().to_string()
}

#[cfg(test)]
mod tests {
    use super::paths::relative;
    use super::*;
    use std::collections::BTreeSet;
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

    fn init(scene: &Path) -> Init {
        let (environment, orbit, frames, out) = (None, None, None, None);
        Init {
            scene: scene.into(),
            ground: false,
            points: false,
            environment,
            orbit,
            frames,
            size: [64, 36],
            out,
            force: false,
        }
    }

    fn dull() -> Needs {
        Needs {
            cameras: (0, false),
            lights: ([0; 3], false),
            emissive: (0, 0.0, 0.0),
            stops: 0,
            seconds: 0.0,
            instances: [0; 2],
            materials: [0; 2],
            triangles: 1,
            diagonal: 1.0,
        }
    }

    fn read(text: &str) -> Graph {
        let graph = Graph::read(text, "test.ron", Path::new(""), &Registry::builtin(), &[]);
        let show = |all: Vec<crate::graph::Diagnostic>| {
            all.iter().map(|d| d.render(false)).collect::<String>()
        };
        let mut graph = graph.unwrap_or_else(|mistakes| panic!("{}\n{text}", show(mistakes)));
        assert!(graph.warnings.is_empty(), "{}", show(std::mem::take(&mut graph.warnings)));
        graph
    }

    fn kinds(graph: &Graph) -> BTreeSet<&'static str> {
        graph.nodes.iter().map(|n| n.kind).collect()
    }

    /// Every combination of what a scene may have gives a graph without mistakes or idle nodes.
    #[test]
    fn every_graph_is_whole() {
        for bits in 0..1 << 10 {
            let on = |bit: u32| bits >> bit & 1 == 1;
            let mut init = init(Path::new("a<b>|{c}.glb"));
            let mut needs = dull();
            init.ground = on(0);
            init.points = on(9);
            init.environment = on(1).then(|| "sky.hdr".into());
            init.orbit = on(2).then_some(-90.0);
            needs.cameras = (usize::from(on(3)), on(3) && on(8));
            needs.lights = ([usize::from(on(4)); 3], on(4) && on(8));
            needs.emissive = if on(5) { (2, 1.0, 9.0) } else { (0, 0.0, 0.0) };
            needs.instances = [usize::from(on(6)); 2];
            needs.materials = [usize::from(on(7)); 2];
            needs.seconds = 1.7;
            let Ok(shot) = Shot::new(&init, &needs) else { panic!("{bits:b} has no shot") };
            let files: Vec<String> = [Some(&init.scene), init.environment.as_ref()]
                .into_iter()
                .flatten()
                .map(|f| format!("{f:?}"))
                .collect();
            let text = init.graph(&needs, &shot, &files, Path::new("test.ron"));
            let graph = read(&text);
            let outputs: Vec<usize> = graph.outputs.iter().map(|(_, node)| *node).collect();
            let idle = graph
                .needed(&outputs)
                .iter()
                .position(|needed| !needed)
                .map(|k| &graph.nodes[k].name);
            assert_eq!(idle, None, "{bits:b}\n{text}");
            let kinds = kinds(&graph);
            let is = |kind: &str| kinds.contains(kind);
            let sky = !(on(1) || on(4) || on(5));
            assert_eq!((is("Sky"), is("SunLights"), is("EnvironmentMap")), (sky, sky, on(1)));
            assert_eq!(
                (is("PunctualLights"), is("EmissiveLights"), is("Ground")),
                (on(4), on(5), on(0))
            );
            assert_eq!((is("Camera"), is("OrbitCamera")), (on(3), on(2) || !on(3)));
            let moving = on(2) || on(6) || on(8) && (on(3) || on(4));
            let matrix = !on(9);
            assert_eq!(
                (is("Frames"), is("PixelMaps"), is("Apng"), is("Png")),
                (moving, moving && matrix, moving, !moving),
                "{bits:b}"
            );
            assert_eq!(
                (is("ColumnClusters"), is("Clusters"), is("PbgiGather"), is("Photons")),
                (!moving && matrix, moving && matrix, on(9), matrix)
            );
            let poses = graph.nodes.iter().filter(|n| n.kind == "Poses").count();
            assert_eq!(poses, 1 + usize::from(on(6)));
            assert!(graph.find("file").is_none() || on(0));
        }
    }

    #[test]
    fn the_error_can_be_uncommented() {
        let init = init(Path::new("a.glb"));
        let Ok(shot) = Shot::new(&init, &dull()) else { panic!("no shot") };
        let text = init.graph(&dull(), &shot, &["\"a.glb\"".into()], Path::new("a.ron"));
        let kinds = kinds(&read(&text.replace("// \"", "\"")));
        assert!(kinds.contains("Reference") && kinds.contains("Compare"));
    }

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
    fn a_shot_fills_the_animation() {
        let mut needs = dull();
        needs.instances = [0, 1];
        needs.seconds = 3.416_67;
        let Ok(shot) = Shot::new(&init(Path::new("a.glb")), &needs) else { panic!("no shot") };
        assert_eq!((shot.frames, shot.fps), (40, 11.707));
        needs.seconds = 1e-5;
        assert!(Shot::new(&init(Path::new("a.glb")), &needs).is_ok_and(|shot| shot.fps == 1000.0));
    }

    #[test]
    fn paths_start_at_the_graph() {
        let from = |folder: &str, file: &str| {
            quoted(Path::new(folder), Path::new(file)).unwrap_or_default()
        };
        assert_eq!(from("", "a/../b.glb"), "\"b.glb\"");
        assert_eq!(from("graphs/x", "scenes/b \"1\".glb"), "\"../../scenes/b \\\"1\\\".glb\"");
        assert_eq!(from("", "$b.glb"), "\"./$b.glb\"");
        assert_eq!(relative(Path::new("/a/b"), Path::new("/a/c/d")), Path::new("../c/d"));
    }

    #[test]
    fn sizes_and_angles() {
        assert_eq!((size("640x360"), angle("-90")), (Ok([640, 360]), Ok(-90.0)));
        assert!(["640", "0x1", "1x16385", "1x1x1"].iter().all(|text| size(text).is_err()));
        assert!(["0", "NaN", "inf", "1e9", "x"].iter().all(|text| angle(text).is_err()));
    }
}
