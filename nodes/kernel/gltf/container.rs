//! The outer layers of a file: GLB or bare JSON, and the lists of the JSON in the `gltf` crate's own
//! types. The crate's readers above those types are not used: they take indices on trust and panic
//! on some broken files. Here every list element is read on its own, so that an error names it.

use super::notes::Notes;
use crate::node::Error;
use gltf::json;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::path::Path;

/// Extensions that are read as far as a [`Scene`](crate::data::Scene) has a place for them.
const READ: [&str; 6] = [
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_texture_transform",
];

/// Extensions that refine the look of a complete metallic-roughness material or animate what a scene
/// does not animate: a file that requires them is still the same scene without them.
const REFINEMENTS: [&str; 11] = [
    "KHR_animation_pointer",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
];

/// The JSON of a file and, for GLB, its binary chunk.
pub(super) struct Container {
    pub(super) json: Map<String, Value>,
    pub(super) binary: Option<Vec<u8>>,
}

/// Reads `path` as GLB (by its magic) or as JSON.
pub(super) fn read(path: &Path) -> Result<Container, Error> {
    let bytes = read_regular(path).map_err(|e| Error::invalid(e.to_string()))?;
    let (value, binary) = if bytes.starts_with(b"glTF") {
        // The crate subtracts its header's size from this length before it looks at it.
        let length = bytes.get(8..12).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        if length < 20 {
            return Err(Error::invalid(
                "not a GLB file: its header gives a length of less than 20 bytes",
            ));
        }
        // Whatever stands behind that length is no part of the file.
        let whole = bytes.get(..length as usize).unwrap_or(&bytes);
        let glb = gltf::Glb::from_slice(whole)
            .map_err(|e| Error::invalid(format!("not a whole GLB file: {e}")))?;
        (parse(&glb.json)?, glb.bin.map(std::borrow::Cow::into_owned))
    } else {
        (parse(&bytes)?, None)
    };
    match value {
        Value::Object(json) => Ok(Container { json, binary }),
        _ => Err(Error::invalid("not glTF: the JSON is not an object")),
    }
}

fn parse(bytes: &[u8]) -> Result<Value, Error> {
    serde_json::from_slice(bytes).map_err(|e| Error::invalid(format!("not glTF: {e}")))
}

/// The bytes of a regular file; pipes and devices, which may never end, are refused.
pub(super) fn read_regular(path: &Path) -> std::io::Result<Vec<u8>> {
    if std::fs::metadata(path)?.is_file() {
        std::fs::read(path)
    } else {
        Err(std::io::Error::other("not a file"))
    }
}

/// A texture, of which `source` may be missing (it is then in an extension that is not read).
#[derive(Deserialize)]
pub(super) struct Texture {
    pub(super) source: Option<usize>,
    pub(super) sampler: Option<usize>,
}

/// The lists of a file, in its order.
pub(super) struct Document {
    pub(super) accessors: Vec<json::Accessor>,
    pub(super) views: Vec<json::buffer::View>,
    pub(super) buffers: Vec<json::Buffer>,
    pub(super) images: Vec<json::Image>,
    pub(super) textures: Vec<Texture>,
    pub(super) samplers: Vec<json::texture::Sampler>,
    pub(super) materials: Vec<json::Material>,
    pub(super) meshes: Vec<json::Mesh>,
    pub(super) nodes: Vec<json::Node>,
    pub(super) skins: Vec<json::Skin>,
    pub(super) cameras: Vec<json::Camera>,
    pub(super) lights: Vec<json::extensions::scene::khr_lights_punctual::Light>,
    /// The animation that was asked for.
    pub(super) animation: Option<json::Animation>,
    /// Roots of the scene to show; none when the file has no scenes and all nodes are shown.
    pub(super) roots: Option<Vec<usize>>,
}

impl Document {
    /// Reads every list, the animation `clip`, and the roots of the default scene (the first one
    /// when none is marked).
    pub(super) fn new(
        mut root: Map<String, Value>,
        clip: u32,
        notes: &Notes,
    ) -> Result<Self, Error> {
        check_version(&root)?;
        check_extensions(&root, notes)?;
        let mut lights = root
            .get_mut("extensions")
            .and_then(|e| e.get_mut("KHR_lights_punctual"))
            .and_then(Value::as_object_mut)
            .map(std::mem::take)
            .unwrap_or_default();
        let root = &mut root;
        Ok(Document {
            animation: animation(root, clip, notes)?,
            roots: roots(root)?,
            accessors: list(root, "accessors")?,
            views: list(root, "bufferViews")?,
            buffers: list(root, "buffers")?,
            images: list(root, "images")?,
            textures: list(root, "textures")?,
            samplers: list(root, "samplers")?,
            materials: list(root, "materials")?,
            meshes: list(root, "meshes")?,
            nodes: list(root, "nodes")?,
            skins: list(root, "skins")?,
            cameras: list(root, "cameras")?,
            lights: list(&mut lights, "lights")?,
        })
    }
}

fn values(root: &mut Map<String, Value>, name: &str) -> Result<Vec<Value>, Error> {
    match root.remove(name) {
        None => Ok(Vec::new()),
        Some(Value::Array(items)) => Ok(items),
        Some(_) => Err(Error::invalid(format!("{name} is not a list"))),
    }
}

fn element<T: DeserializeOwned>(value: Value, name: &str, i: usize) -> Result<T, Error> {
    serde_json::from_value(value).map_err(|e| Error::invalid(format!("{name}[{i}]: {e}")))
}

fn list<T: DeserializeOwned>(root: &mut Map<String, Value>, name: &str) -> Result<Vec<T>, Error> {
    values(root, name)?.into_iter().enumerate().map(|(i, value)| element(value, name, i)).collect()
}

/// A list that only names files, for finding them: broken elements are skipped.
pub(super) fn uris(root: &Map<String, Value>, name: &str) -> Vec<String> {
    let items = root.get(name).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    items.iter().filter_map(|item| item.get("uri")?.as_str().map(str::to_owned)).collect()
}

fn check_version(root: &Map<String, Value>) -> Result<(), Error> {
    let version = root.get("asset").and_then(|a| a.get("version")).and_then(Value::as_str);
    match version {
        Some(version) if version.split('.').next() == Some("2") => Ok(()),
        Some(version) => Err(Error::invalid(format!("asset.version is {version:?}, expected 2.x"))),
        None => Err(Error::invalid("not glTF 2.0: asset.version is missing")),
    }
}

fn check_extensions(root: &Map<String, Value>, notes: &Notes) -> Result<(), Error> {
    let names = |key: &str| -> Vec<&str> {
        root.get(key)
            .and_then(Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect()
    };
    let known = |name: &&str| READ.contains(name) || REFINEMENTS.contains(name);
    let missing: Vec<&str> =
        names("extensionsRequired").into_iter().filter(|name| !known(name)).collect();
    if !missing.is_empty() {
        let list = missing.join(", ");
        return Err(Error::invalid(format!("the file requires {list}, which is not supported")));
    }
    for name in names("extensionsUsed").iter().filter(|name| !READ.contains(name)) {
        notes.count("extensions ignored", name);
    }
    Ok(())
}

fn animation(
    root: &mut Map<String, Value>,
    clip: u32,
    notes: &Notes,
) -> Result<Option<json::Animation>, Error> {
    let mut animations = values(root, "animations")?;
    let at = clip as usize;
    if at >= animations.len() {
        let found = animations.len();
        let none = found == 0 && clip == 0;
        return if none {
            Ok(None)
        } else {
            Err(Error::invalid(format!("there is no clip {clip}: the file has {found}")))
        };
    }
    let mut value = animations.swap_remove(at);
    // A channel may lack a node (its target is then in an extension), which the crate's type cannot say.
    if let Some(channels) = value.get_mut("channels").and_then(Value::as_array_mut) {
        channels.retain(|channel| {
            let target = channel.get("target");
            let pointer =
                target.and_then(|t| t.get("extensions")?.get("KHR_animation_pointer")).is_some();
            let keep = target.is_none_or(|t| t.get("node").is_some()) && !pointer;
            if !keep {
                notes.count(
                    "animation channels that do not move a node left out",
                    &format!("animations[{clip}]"),
                );
            }
            keep
        });
    }
    element(value, "animations", at).map(Some)
}

fn roots(root: &mut Map<String, Value>) -> Result<Option<Vec<usize>>, Error> {
    let mut scenes = values(root, "scenes")?;
    let at = match root.get("scene") {
        None if scenes.is_empty() => return Ok(None),
        None => 0,
        Some(value) => {
            value.as_u64().map_or(usize::MAX, |i| usize::try_from(i).unwrap_or(usize::MAX))
        }
    };
    if at >= scenes.len() {
        return Err(Error::invalid(format!(
            "the default scene is not among the {} of the file",
            scenes.len()
        )));
    }
    #[derive(Deserialize)]
    struct Roots {
        #[serde(default)]
        nodes: Vec<usize>,
    }
    element::<Roots>(scenes.swap_remove(at), "scenes", at).map(|scene| Some(scene.nodes))
}
