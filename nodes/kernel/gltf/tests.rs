//! What a scene holds of small files.

use super::fixtures::{Pack, data_uri, import, scene, triangle};
use crate::data::{Channel, Primitive, alpha, channel};
use glam::{Mat4, Vec3};
use serde_json::json;

#[test]
fn a_triangle_with_the_default_material() {
    let mut pack = Pack::default();
    let rest = triangle(&mut pack);
    let scene = scene(&pack.file(rest));
    assert_eq!(scene.position[..], [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(
        (scene.triangle[..].to_vec(), scene.instance[..].to_vec()),
        (vec![[0, 1, 2]], vec![[0, 0, u32::MAX]])
    );
    let primitive = Primitive::from(scene.primitive[0]);
    assert_eq!((primitive.material, primitive.triangles, primitive.vertices), (0, 1, 3));
    assert_eq!(scene.metallic_roughness[..], [[1.0, 1.0]]);
    assert!(
        scene.colour.is_empty()
            && scene.weight.is_empty()
            && scene.normal.iter().all(|n| *n == Vec3::ZERO)
    );
}

#[test]
fn strips_with_indices_use_only_their_vertices() {
    let mut pack = Pack::default();
    let points: Vec<f32> = (0..6).flat_map(|i| [i as f32, (i * i) as f32, 0.0]).collect();
    let position = pack.floats("VEC3", 3, &points);
    let indices = pack.indices(&[5, 1, 2, 3]);
    let primitive =
        json!({ "attributes": { "POSITION": position }, "indices": indices, "mode": 5 });
    let rest = json!({ "nodes": [{ "mesh": 0 }], "meshes": [{ "primitives": [primitive] }] });
    let scene = scene(&pack.file(rest));
    let x: Vec<f32> = scene.position.iter().map(|p| p.x).collect();
    assert_eq!(
        (x, scene.triangle[..].to_vec()),
        (vec![1.0, 2.0, 3.0, 5.0], vec![[3, 0, 1], [0, 2, 1]])
    );
}

#[test]
fn sparse_values_stand_on_zeros() {
    let mut pack = Pack::default();
    let rows = pack.view(&[1, 2]);
    let values = pack.view(bytemuck::cast_slice(&[1.0_f32, 0.0, 0.0, 0.0, 1.0, 0.0]));
    let sparse = json!({ "count": 2, "indices": { "bufferView": rows, "componentType": 5121 },
        "values": { "bufferView": values } });
    pack.accessors
        .push(json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse }));
    let primitive = json!({ "attributes": { "POSITION": 0 } });
    let rest = json!({ "nodes": [{ "mesh": 0 }], "meshes": [{ "primitives": [primitive] }] });
    assert_eq!(scene(&pack.file(rest)).position[..], [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn gpu_instances_are_rows_with_offsets() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let translation = pack.floats("VEC3", 3, &[1.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
    let rotation = pack.floats("VEC4", 4, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    rest["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({ "TRANSLATION": translation, "ROTATION": rotation });
    rest["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let scene = scene(&pack.file(rest));
    assert_eq!(scene.instance[..], [[0, 0, u32::MAX]; 2]);
    let moved =
        |i: usize| Mat4::from_cols_array(&scene.instance_offset[i]).transform_point3(Vec3::X);
    assert_eq!((moved(0), moved(1)), (Vec3::X * 2.0, Vec3::X));
}

#[test]
fn cubic_keys_keep_their_tangents_and_linear_rotations_are_normalised() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let times = pack.floats("SCALAR", 1, &[0.0, 2.0]);
    let moves = pack.floats("VEC3", 3, &std::array::from_fn::<_, 18, _>(|i| i as f32));
    let turns = pack.floats("VEC4", 4, &[0.0, 0.0, 0.0, 2.0, 0.0, 3.0, 0.0, 0.0]);
    rest["animations"] = json!([{
        "samplers": [{ "input": times, "output": moves, "interpolation": "CUBICSPLINE" }, { "input": times, "output": turns }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } },
            { "sampler": 0, "target": { "path": "pointer" } },
            { "sampler": 1, "target": { "node": 0, "path": "rotation" } }] }]);
    let (scene, notes) = import(&pack.file(rest));
    let scene = scene.unwrap();
    let [cubic, linear] = [0, 1].map(|i| Channel::from(scene.channel[i]));
    assert_eq!(
        (cubic.path, cubic.interpolation, cubic.keys),
        (channel::TRANSLATION, channel::CUBIC, 2)
    );
    assert_eq!((linear.path, linear.interpolation), (channel::ROTATION, channel::LINEAR));
    assert_eq!((linear.first_key, linear.first_value), (2, 18));
    assert_eq!(scene.key_time[..], [0.0, 2.0, 0.0, 2.0]);
    assert_eq!(scene.key_value[3..6], [3.0, 4.0, 5.0]);
    assert_eq!(scene.key_value[18..], [0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0]);
    assert!(
        notes.len() == 1 && notes[0].starts_with("1 animation channels that do not move a node"),
        "{notes:?}"
    );
}

#[test]
fn materials_with_textures_on_their_own_coordinates() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let uv = pack.floats("VEC2", 2, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let mut png = std::io::Cursor::new(Vec::new());
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_vec(
        2,
        1,
        vec![65535_u16, 0, 32896, 0, 257, 0],
    )
    .unwrap();
    deep.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let transform = json!({ "offset": [0.5, 0.0], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2.0, 3.0] });
    rest["images"] = json!([{ "uri": data_uri(png.get_ref()) }, { "uri": "gone.png" }]);
    rest["textures"] = json!([{ "source": 1 }, { "source": 0 }]);
    rest["materials"] = json!([{
        "pbrMetallicRoughness": { "baseColorTexture":
            { "index": 1, "texCoord": 1, "extensions": { "KHR_texture_transform": transform } } },
        "emissiveTexture": { "index": 0, "texCoord": 1 }, "emissiveFactor": [1.0, 0.5, 0.0], "alphaMode": "BLEND",
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 } } },
        { "extensions": { "KHR_materials_transmission": { "transmissionFactor": 0.9 } }, "doubleSided": true },
        { "alphaMode": "MASK", "alphaCutoff": 0.25,
            "extensions": { "KHR_materials_specular": { "specularFactor": 0.0 } } }]);
    rest["meshes"][0]["primitives"][0]["material"] = json!(0);
    rest["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(uv);
    let (scene, notes) = import(&pack.file(rest));
    let scene = scene.unwrap();
    assert_eq!(scene.uv[1].to_array(), [1.0, 0.0]);
    assert_eq!(scene.material_texture[0], [0.0, -1.0, -1.0]);
    assert_eq!(
        (scene.texture[..].to_vec(), scene.texel[..].to_vec()),
        (vec![[0, 2, 1]], vec![[255, 0, 128, 255], [0, 1, 0, 255]])
    );
    let affine: Vec<f32> = scene.texture_transform[0][..6].iter().map(|v| v.round()).collect();
    assert_eq!((affine, scene.texture_transform[0][2]), (vec![0.0, 3.0, 1.0, -2.0, 0.0, 0.0], 0.5));
    assert_eq!(scene.emissive[0], Vec3::new(4.0, 2.0, 0.0));
    assert_eq!(
        scene.alpha_mode[..],
        [[alpha::MASK, 0.5], [alpha::ABSENT, 0.5], [alpha::MASK, 0.25]]
    );
    assert_eq!(
        (scene.double_sided[..].to_vec(), scene.specular_factor[..].to_vec()),
        (vec![0, 1, 0], vec![1.0, 1.0, 0.0])
    );
    assert!(
        notes.iter().any(|n| n.contains("gone.png")) && notes.iter().any(|n| n.contains("blend")),
        "{notes:?}"
    );
}

#[test]
fn skins_and_morph_targets() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let joint = pack.view(&[0, 0, 0, 0, 1, 0, 0, 0, 1, 9, 0, 0]);
    pack.accessors
        .push(json!({ "bufferView": joint, "componentType": 5121, "count": 3, "type": "VEC4" }));
    let joints = pack.accessors.len() - 1;
    let weights =
        pack.floats("VEC4", 4, &[1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let normal = pack.floats("VEC3", 3, &[1.0; 9]);
    rest["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
    rest["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    rest["meshes"][0]["primitives"][0]["targets"] = json!([{}, { "NORMAL": normal }]);
    rest["meshes"][0]["weights"] = json!([0.25]);
    rest["nodes"] = json!([{ "mesh": 0, "skin": 0 }, { "children": [2] }, {}]);
    rest["skins"] = json!([{ "joints": [1, 2] }]);
    let (scene, notes) = import(&pack.file(rest));
    let scene = scene.unwrap();
    assert_eq!((scene.weight[1], scene.joint[1]), ([1.0, 0.0, 0.0, 0.0], [1, 0, 0, 0]));
    assert_eq!(
        (scene.instance[0], scene.skin[0], scene.skin_joint[..].to_vec()),
        ([0, 0, 0], [0, 2], vec![1, 2])
    );
    assert_eq!(scene.skin_inverse_bind[1], Mat4::IDENTITY.to_cols_array());
    assert_eq!(
        (scene.morph_target[..].to_vec(), scene.morph_normal[2]),
        (vec![[0, 1, 0]], Vec3::ONE)
    );
    assert_eq!(
        (scene.morph_position[2], scene.node_weight[0], scene.rest_weight[..].to_vec()),
        (Vec3::ZERO, [0, 2], vec![0.25, 0.0])
    );
    assert_eq!(scene.node_parent[..], [-1, -1, 1]);
    assert_eq!(notes, ["1 sets of skin weights normalised (first: meshes[0].primitives[0])"]);
}

#[test]
fn lights_and_cameras_of_the_default_scene() {
    let spot = json!({ "type": "spot", "color": [1.0, 0.5, 0.0], "intensity": 10.0,
        "spot": { "innerConeAngle": 0.0, "outerConeAngle": std::f32::consts::FRAC_PI_3 } });
    let light = json!({ "KHR_lights_punctual": { "light": 0 } });
    let file = json!({
        "asset": { "version": "2.0" }, "scene": 1,
        "scenes": [{ "nodes": [0] }, { "nodes": [1] }],
        "nodes": [{ "camera": 0 }, { "children": [2], "scale": [1, 1, -1] }, { "camera": 0, "extensions": light }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.25 } }],
        "extensions": { "KHR_lights_punctual": { "lights": [spot] } } });
    let scene = scene(&file);
    assert_eq!(scene.camera[..], [[2.0, 0.5, 0.0, 0.25, f32::MAX]]);
    assert_eq!(scene.node_scale[1], Vec3::new(1.0, 1.0, -1.0));
    let [node, kind, r, g, b, inner, outer] = scene.light[0];
    assert_eq!([node, kind, r, g, b, inner], [2.0, 1.0, 10.0, 5.0, 0.0, 1.0]);
    assert!((outer - 0.5).abs() < 1e-6);
}

#[test]
fn vertex_colours_of_bytes_fill_up_with_white() {
    let mut pack = Pack::default();
    let mut rest = triangle(&mut pack);
    let bytes = pack.view(&[255, 0, 51, 0, 0, 0, 0, 0, 0]);
    pack.accessors.push(
        json!({ "bufferView": bytes, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC3" }),
    );
    let mut coloured = rest["meshes"][0]["primitives"][0].clone();
    coloured["attributes"]["COLOR_0"] = json!(pack.accessors.len() - 1);
    let plain = rest["meshes"][0]["primitives"][0].clone();
    rest["meshes"][0]["primitives"] = json!([plain, coloured, plain]);
    let scene = scene(&pack.file(rest));
    assert_eq!(scene.colour.len(), 9);
    assert_eq!(
        (scene.colour[0], scene.colour[3], scene.colour[8]),
        ([1.0; 4], [1.0, 0.0, 0.2, 1.0], [1.0; 4])
    );
}
