//! Real files, when they are there.

use super::{container, import};
use crate::data::Scene;
use crate::node::{Ctx, Error};
use glam::{Mat4, Quat, Vec3};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const SCENES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/scenes");

fn scenes() -> Option<&'static Path> {
    let path = Path::new(SCENES);
    if !path.is_dir() {
        println!("skipped: ../shared is absent");
    }
    path.is_dir().then_some(path)
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Triangles over all instances, after checking that every index leads somewhere.
fn checked_triangles(scene: &Scene) -> u64 {
    let mut of_mesh =
        vec![0_u64; scene.instance.iter().map(|i| i[1] as usize + 1).max().unwrap_or(0)];
    let materials = scene.base_colour.len();
    for [mesh, material, first, triangles, first_vertex, vertices] in
        scene.primitive.iter().copied()
    {
        of_mesh[mesh as usize] += u64::from(triangles);
        assert!((material as usize) < materials);
        let range = first_vertex..first_vertex + vertices;
        let rows = &scene.triangle[first as usize..][..triangles as usize];
        assert!(rows.as_flattened().iter().all(|v| range.contains(v)));
    }
    let vertices = scene.position.len();
    assert!(scene.normal.len() == vertices && scene.uv.len() == vertices);
    assert!(
        [0, vertices].contains(&scene.colour.len()) && [0, vertices].contains(&scene.weight.len())
    );
    assert!(scene.primitive.is_sorted_by_key(|p| p[0]) && scene.joint.len() == scene.weight.len());
    assert!(
        scene.position.iter().all(|p| p.is_finite())
            && scene.instance.len() == scene.instance_offset.len()
    );
    assert!(scene.channel.iter().all(|c| (c[0] as usize) < scene.node_parent.len()));
    assert!(scene.material_texture.as_flattened().iter().all(|t| *t < scene.texture.len() as f32));
    scene.instance.iter().map(|i| of_mesh[i[1] as usize]).sum()
}

/// Imports a file, and once more with a node added for every mesh, so that meshes of no node are
/// read too. Gives the triangles of the first.
fn attempt(path: &Path) -> Result<u64, Error> {
    let ctx = Ctx::default();
    if let Ok(mut container) = container::read(path) {
        let meshes = container.json.get("meshes").and_then(Value::as_array).map_or(0, Vec::len);
        let nodes = container.json.entry("nodes").or_insert_with(|| json!([]));
        if let Some(nodes) = nodes.as_array_mut() {
            nodes.extend((0..meshes).map(|mesh| json!({ "mesh": mesh })));
            container.json.remove("scene");
            container.json.remove("scenes");
            match super::assemble(container, super::folder(path), 0, &ctx) {
                Ok(scene) => drop(checked_triangles(&scene)),
                Err(e) => assert!(names_something(&e.to_string()), "{e}"),
            }
        }
    }
    Ok(checked_triangles(&import(path, 0, &ctx)?))
}

/// Whether a message says where the fault is and not only that there is one.
fn names_something(text: &str) -> bool {
    let lists = [
        "accessors",
        "buffer",
        "nodes[",
        "meshes[",
        "skins[",
        "camera",
        "lights[",
        "materials[",
        "textures[",
    ];
    let others = [
        "samplers",
        "images",
        "scene",
        "animation",
        "asset",
        "requires",
        "GLB",
        "glTF",
        "is not a list",
        "clip",
    ];
    lists.iter().chain(&others).any(|part| text.contains(part))
}

#[test]
fn no_file_of_the_corpora_panics_and_every_error_names_something() {
    let Some(scenes) = scenes() else { return };
    let folders = [
        "gltf_validator_corpus",
        "gltf_broken_tinygltf",
        "gltf_compressed",
        "gltf_asset_generator",
    ];
    for (folder, least) in folders.into_iter().zip([200, 10, 4, 70]) {
        let files = files(&scenes.join(folder));
        assert!(files.len() >= least, "{folder} has {} files", files.len());
        let mut imported = 0;
        for file in &files {
            match attempt(file) {
                Ok(_) => imported += 1,
                Err(Error::File { what, .. }) => {
                    assert!(names_something(&what), "{}: {what}", file.display())
                }
                Err(e) => panic!("{}: {e}", file.display()),
            }
        }
        println!("{folder}: {imported} of {} imported", files.len());
    }
}

#[test]
fn scenes_have_the_stated_triangles() {
    let Some(scenes) = scenes() else { return };
    for (file, triangles) in [
        ("animated_morph_cube/AnimatedMorphCube.glb", 12),
        ("box_animated/BoxAnimated.glb", 254),
        ("box_vertex_colors/BoxVertexColors.glb", 12),
        ("cameras/Cameras.gltf", 2),
        ("cesium_milk_truck/CesiumMilkTruck.glb", 3_624),
        ("cornell_bevy/CornellBox.glb", 36),
        ("cornell_embree/cornell_box.glb", 36),
        ("cubes_light/Cubes.glb", 36),
        ("flight_helmet/FlightHelmet.gltf", 94_722),
        ("fox/Fox.glb", 576),
        ("house/house.glb", 1_013_385),
        ("living-room/living-room.glb", 143_163),
        ("morph_stress/MorphStressTest.gltf", 2_412),
        ("normal_tangent_test/NormalTangentTest.glb", 7_774),
        ("pine_tree/forest_instanced.gltf", 328_350),
        ("pine_tree/pine.gltf", 1_650),
        ("rigged_simple/RiggedSimple.glb", 188),
        ("simple_morph/SimpleMorph.gltf", 1),
        ("simple_skin/SimpleSkin.gltf", 8),
        ("simple_sparse/SimpleSparseAccessor.gltf", 12),
        ("staircase/staircase.glb", 262_663),
        ("staircase2/staircase2.glb", 31_087),
        ("terrain_mountains/Mountains.gltf", 25_600),
        ("three_lights/cube_three_lights.glb", 12),
        ("two_sided_plane/TwoSidedPlane.gltf", 2),
        ("volumetric_fog_light/VolumetricFogExample.glb", 360),
    ] {
        let scene =
            import(&scenes.join(file), 0, &Ctx::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(checked_triangles(&scene), triangles, "{file}");
    }
}

#[test]
fn scenes_have_what_the_table_says() {
    let Some(scenes) = scenes() else { return };
    let read = |file: &str| {
        import(&scenes.join(file), 0, &Ctx::default()).unwrap_or_else(|e| panic!("{e}"))
    };
    let fox = read("fox/Fox.glb");
    assert_eq!((fox.skin.len(), fox.skin_joint.len(), fox.texture.len()), (1, 24, 1));
    assert!(fox.channel.len() > 10 && !fox.weight.is_empty());
    assert!(
        import(&scenes.join("fox/Fox.glb"), 3, &Ctx::default())
            .unwrap_err()
            .to_string()
            .contains("clip 3")
    );
    let stairs = read("staircase2/staircase2.glb");
    let emitters = stairs.emissive.iter().filter(|e| e.max_element() > 0.0).count();
    assert_eq!((stairs.base_colour.len(), emitters), (21, 13));
    let lamps = read("three_lights/cube_three_lights.glb");
    let mut kinds: Vec<f32> = lamps.light.iter().map(|l| l[1]).collect();
    kinds.sort_by(f32::total_cmp);
    assert_eq!(kinds, [0.0, 1.0, 2.0]);
    assert_eq!(read("cameras/Cameras.gltf").camera.len(), 2);
    assert_eq!(read("pine_tree/forest_instanced.gltf").instance.len() % 199, 0);
    assert!(read("box_vertex_colors/BoxVertexColors.glb").colour.len() > 8);
}

/// Extent of the scene at rest, unskinned, in world space.
fn extent(scene: &Scene) -> Vec3 {
    let local = |n: usize| {
        let rotation = Quat::from_array(scene.node_rotation[n]);
        Mat4::from_scale_rotation_translation(
            scene.node_scale[n],
            rotation,
            scene.node_translation[n],
        )
    };
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (&[node, mesh, _], offset) in scene.instance.iter().zip(scene.instance_offset.iter()) {
        let mut world = Mat4::from_cols_array(offset);
        let mut node = node as i32;
        while let Ok(n) = usize::try_from(node) {
            world = local(n) * world;
            node = scene.node_parent[n];
        }
        for primitive in scene.primitive.iter().filter(|p| p[0] == mesh) {
            for position in &scene.position[primitive[4] as usize..][..primitive[5] as usize] {
                let point = world.transform_point3(*position);
                (low, high) = (low.min(point), high.max(point));
            }
        }
    }
    high - low
}

#[test]
fn scenes_have_the_stated_extent() {
    let Some(scenes) = scenes() else { return };
    for (file, stated) in [
        ("cesium_milk_truck/CesiumMilkTruck.glb", [4.87, 2.58, 2.79]),
        ("cornell_embree/cornell_box.glb", [556.0, 549.0, 559.0]),
        ("cubes_light/Cubes.glb", [8.89, 5.53, 6.63]),
        ("flight_helmet/FlightHelmet.gltf", [0.367, 0.716, 0.372]),
        ("living-room/living-room.glb", [5.64, 2.88, 4.23]),
        ("staircase/staircase.glb", [6.61, 7.32, 10.3]),
        ("staircase2/staircase2.glb", [28.9, 15.1, 10.0]),
        ("terrain_mountains/Mountains.gltf", [2.0, 0.335, 2.01]),
    ] {
        let scene =
            import(&scenes.join(file), 0, &Ctx::default()).unwrap_or_else(|e| panic!("{e}"));
        let found = extent(&scene);
        let near = found.to_array().iter().zip(stated).all(|(a, b)| (a - b).abs() <= 0.006 * b);
        assert!(near, "{file}: {found}, stated {stated:?}");
    }
}
