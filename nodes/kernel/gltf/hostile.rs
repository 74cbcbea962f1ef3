//! Broken files end in errors that name the fault.

use super::fixtures::{Pack, error, import, triangle};
use serde_json::{Value, json};

fn broken(change: impl FnOnce(&mut Value)) -> String {
    let mut pack = Pack::default();
    let rest = triangle(&mut pack);
    let mut file = pack.file(rest);
    change(&mut file);
    error(&file)
}

#[test]
fn faults_are_named() {
    type Case = (fn(&mut Value), &'static [&'static str]);
    let cases: [Case; 12] = [
        (
            |f| f["nodes"] = json!([{ "children": [1] }, { "children": [0] }]),
            &["nodes[", "own ancestor"],
        ),
        (
            |f| f["nodes"] = json!([{ "children": [2] }, { "children": [2] }, {}]),
            &["nodes[2]", "nodes[0]"],
        ),
        (|f| f["nodes"][0]["mesh"] = json!(7), &["meshes[7]"]),
        (
            |f| f["buffers"][0]["byteLength"] = json!(1_000_000_000_000_u64),
            &["buffers[0]", "36 bytes"],
        ),
        (
            |f| f["bufferViews"][0]["byteLength"] = json!(u64::MAX),
            &["bufferViews[0]", "past the end"],
        ),
        (|f| f["bufferViews"][0]["byteStride"] = json!(8), &["accessors[0]", "8 bytes apart"]),
        (
            |f| f["accessors"][0]["count"] = json!(4),
            &["meshes[0].primitives[0]", "accessors[0]", "past the end"],
        ),
        (
            |f| {
                f["accessors"][0] =
                    json!({ "componentType": 5126, "count": 4e15 as u64, "type": "VEC3" })
            },
            &["without data"],
        ),
        (
            |f| f["extensionsRequired"] = json!(["ACME_x", "KHR_draco_mesh_compression"]),
            &["ACME_x, KHR_draco"],
        ),
        (|f| f["asset"]["version"] = json!("1.0"), &["\"1.0\""]),
        (|f| f["nodes"][0]["translation"] = json!([1e300, 0, 0]), &["nodes[0]", "finite"]),
        (
            |f| f["meshes"][0]["primitives"][0]["material"] = json!(0),
            &["meshes[0].primitives[0]", "materials[0]"],
        ),
    ];
    for (i, (change, parts)) in cases.into_iter().enumerate() {
        let text = broken(change);
        assert!(parts.iter().all(|part| text.contains(part)), "case {i}: {text}");
    }
}

#[test]
fn an_index_past_the_vertices() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    rest["meshes"][0]["primitives"][0]["indices"] = json!(pack.indices(&[0, 1, 3]));
    let text = error(&pack.file(rest));
    assert!(text.contains("meshes[0].primitives[0]: indices: accessors[1] has vertex 3"), "{text}");
}

#[test]
fn a_number_that_is_none() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let position = pack.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, f32::NAN, 0.0, 0.0, 1.0, 0.0]);
    rest["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(position);
    let text = error(&pack.file(rest));
    assert!(
        text.contains("meshes[0].primitives[0]: POSITION: accessors[1]")
            && text.contains("element 1"),
        "{text}"
    );
}

#[test]
fn a_vertex_that_needs_a_joint_too_many() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let joint = pack.view(&[0, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0]);
    pack.accessors
        .push(json!({ "bufferView": joint, "componentType": 5121, "count": 3, "type": "VEC4" }));
    let joints = pack.accessors.len() - 1;
    let weights =
        pack.floats("VEC4", 4, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    rest["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
    rest["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    rest["nodes"] = json!([{ "mesh": 0, "skin": 0 }]);
    rest["skins"] = json!([{ "joints": [0] }]);
    let text = error(&pack.file(rest));
    assert!(text.contains("nodes[0]: skins[0] has 1 joints, but a vertex needs joint 3"), "{text}");
}

#[test]
fn times_that_do_not_increase() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let times = pack.floats("SCALAR", 1, &[1.0, 1.0]);
    let moves = pack.floats("VEC3", 3, &[0.0; 6]);
    rest["animations"] = json!([{ "samplers": [{ "input": times, "output": moves }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "scale" } }] }]);
    let text = error(&pack.file(rest));
    assert!(text.contains("animation channel 0: the times in accessors[1]"), "{text}");
}

/// Every value inside `value`, by its path.
fn paths(value: &Value, prefix: &str, out: &mut Vec<String>) {
    out.push(prefix.to_owned());
    match value {
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, v)| paths(v, &format!("{prefix}/{i}"), out))
        }
        Value::Object(map) => {
            map.iter().for_each(|(key, v)| paths(v, &format!("{prefix}/{key}"), out))
        }
        _ => {}
    }
}

#[test]
fn no_single_change_of_a_value_panics() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let numbers = pack.floats("VEC4", 4, &[0.25; 12]);
    let times = pack.floats("SCALAR", 1, &[0.0, 1.0, 2.0]);
    let indices = pack.indices(&[0, 1, 2]);
    let rows = pack.view(&[1]);
    let sparse = json!({ "count": 1, "indices": { "bufferView": rows, "componentType": 5121 },
        "values": { "bufferView": 0 } });
    pack.accessors
        .push(json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse }));
    pack.accessors
        .push(json!({ "bufferView": 0, "componentType": 5121, "count": 3, "type": "VEC4" }));
    let (sparse, joints) = (pack.accessors.len() - 2, pack.accessors.len() - 1);
    rest["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0, "NORMAL": sparse, "JOINTS_0": joints, "WEIGHTS_0": numbers, "COLOR_0": numbers });
    rest["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    rest["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": sparse }]);
    rest["meshes"][0]["primitives"][0]["material"] = json!(0);
    let instancing = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": sparse, "ROTATION": numbers } },
        "KHR_lights_punctual": { "light": 0 } });
    rest["nodes"] = json!([{ "mesh": 0, "children": [1], "skin": 0, "extensions": instancing },
        { "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], "camera": 0 }]);
    rest["skins"] = json!([{ "joints": [0, 1] }]);
    rest["cameras"] = json!([{ "type": "orthographic", "orthographic": { "xmag": 1, "ymag": 1, "znear": 0, "zfar": 9 } }]);
    rest["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": { "outerConeAngle": 1 } }] } });
    rest["images"] = json!([{ "bufferView": 0 }]);
    rest["textures"] = json!([{ "source": 0, "sampler": 0 }]);
    rest["samplers"] = json!([{ "wrapS": 33071 }]);
    rest["materials"] = json!([{ "emissiveTexture": { "index": 0, "texCoord": 0,
        "extensions": { "KHR_texture_transform": { "scale": [1, 2] } } }, "alphaMode": "MASK", "alphaCutoff": 0.5 }]);
    rest["animations"] = json!([{ "samplers": [{ "input": times, "output": times, "interpolation": "STEP" }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "weights" } }] }]);
    rest["scenes"] = json!([{ "nodes": [0] }]);
    rest["scene"] = json!(0);
    let mut file = pack.file(rest);
    let (found, _) = import(&file);
    assert_eq!(found.unwrap_or_else(|e| panic!("{e}")).instance.len(), 3);
    let mut all = Vec::new();
    paths(&file, "", &mut all);
    let bad = [
        json!(0),
        json!(1),
        json!(-1),
        json!(3.5),
        json!(5126),
        json!(u32::MAX),
        json!(u64::MAX),
        json!(1e300),
        json!("MAT4"),
        json!([]),
        json!({}),
        json!([null]),
        Value::Null,
    ];
    let mut refused = 0;
    for path in all.iter().filter(|path| !path.is_empty()) {
        for value in &bad {
            let slot = file.pointer_mut(path).unwrap();
            let kept = std::mem::replace(slot, value.clone());
            refused += usize::from(import(&file).0.is_err());
            *file.pointer_mut(path).unwrap() = kept;
        }
    }
    assert!(refused > all.len() * 3, "{refused} of {}", all.len() * bad.len());
}

#[test]
fn no_cut_or_changed_byte_of_a_glb_panics() {
    let json = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4}]}    "#;
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((12 + 8 + json.len() as u32 + 8 + 4).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(json);
    glb.extend(b"\x04\0\0\0BIN\0abcd");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.glb");
    let import = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        super::import(&path, 0, &crate::node::Ctx::default()).is_ok()
    };
    assert!(import(&glb) && import(&[&glb[..], b"rest"].concat()));
    for length in 0..glb.len() {
        assert!(!import(&glb[..length]), "{length} bytes");
    }
    for at in 0..glb.len() {
        for byte in [0, 1, 0x7f, 0xff] {
            let mut changed = glb.clone();
            changed[at] = byte;
            import(&changed);
        }
    }
}
