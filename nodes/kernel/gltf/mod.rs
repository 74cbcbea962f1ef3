//! glTF 2.0 files as scenes.
//!
//! Files are hostile: every index and every range is checked before it is used, nothing is allocated
//! because a header says so, and no call into the `gltf` crate can panic, since only its JSON types
//! and its GLB splitter are used. What has no place in a [`Scene`] is counted and told.

mod accessors;
mod animation;
mod buffers;
mod container;
#[cfg(test)]
mod corpus;
#[cfg(test)]
mod fixtures;
mod hierarchy;
#[cfg(test)]
mod hostile;
mod instances;
mod materials;
mod meshes;
mod morphs;
mod notes;
mod sensors;
mod skinning;
#[cfg(test)]
mod tests;
mod textures;
mod topology;
mod transform;

use crate::data::Scene;
use crate::node::{Ctx, Error};
use std::path::{Path, PathBuf};

/// Reads the glTF or GLB file at `path` with the animation numbered `clip`: the default scene (the
/// first one if none is marked, all nodes if there are none). Meshes of no node are left out, and so
/// are vertices of no triangle; nodes and skins keep the numbers of the file. Repairs and omissions
/// are told to `ctx` with their counts.
///
/// # Errors
/// [`Error::File`] that names the element at fault: damaged or missing buffers, indices and ranges
/// that lead nowhere, numbers that are not finite, nodes that are no trees, unsupported required
/// extensions, a clip that is not there (a file without animations has clip 0, which is empty).
/// [`Error::Cancelled`] when `ctx` says so.
pub fn import(path: &Path, clip: u32, ctx: &Ctx) -> Result<Scene, Error> {
    read(path, clip, ctx).map_err(|e| match e {
        Error::Invalid(what) => Error::file(path, what),
        other => other,
    })
}

/// The file at `path` and every buffer and image file that it names, whether they exist or not. Only
/// the file itself when it cannot be read.
pub fn references(path: &Path) -> Vec<PathBuf> {
    let mut files = vec![path.to_owned()];
    if let Ok(container) = container::read(path) {
        for text in
            ["buffers", "images"].iter().flat_map(|list| container::uris(&container.json, list))
        {
            match buffers::Uri::new(&text, folder(path)) {
                buffers::Uri::File(file) if !files.contains(&file) => files.push(file),
                _ => {}
            }
        }
    }
    files
}

fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

fn read(path: &Path, clip: u32, ctx: &Ctx) -> Result<Scene, Error> {
    assemble(container::read(path)?, folder(path), clip, ctx)
}

/// The scene of a container whose files are in `folder`.
fn assemble(
    container: container::Container,
    folder: &Path,
    clip: u32,
    ctx: &Ctx,
) -> Result<Scene, Error> {
    let notes = notes::Notes::default();
    let document = container::Document::new(container.json, clip, &notes)?;
    let hierarchy = hierarchy::Hierarchy::read(&document, &notes)?;
    let buffers = buffers::Buffers::read(&document, folder, container.binary)?;
    let accessors = accessors::Accessors::new(&document, &buffers);
    let mut textures = textures::Textures::new(&document, &buffers, folder, &notes);
    let mut materials = materials::Materials::read(&document, &mut textures, ctx, &notes)?;
    let (meshes, instances) =
        instances::read(&document, &accessors, &materials, &hierarchy, (&notes, ctx))?;
    if meshes.default_material || materials.uv_set.is_empty() {
        materials.push_default();
    }
    let skins = instances::Skins::read(&document, &accessors)?;
    let animation = animation::Animation::read(&document, &accessors, &instances, &notes)?;
    let (node_weight, rest_weight) = animation::rest_weights(&document, &instances)?;
    let cameras = sensors::cameras(&document, &hierarchy)?;
    let lights = sensors::lights(&document, &hierarchy, &notes)?;
    notes.tell(ctx);
    Ok(Scene {
        position: meshes.position.into(),
        normal: meshes.normal.into(),
        uv: meshes.uv.into(),
        colour: meshes.colour.into(),
        joint: meshes.joint.into(),
        weight: meshes.weight.into(),
        triangle: meshes.triangle.into(),
        primitive: meshes.primitive.into(),
        morph_target: meshes.morph_target.into(),
        morph_position: meshes.morph_position.into(),
        morph_normal: meshes.morph_normal.into(),
        node_parent: hierarchy.parent.into(),
        node_translation: hierarchy.rest.iter().map(|t| t.translation).collect(),
        node_rotation: hierarchy.rest.iter().map(|t| t.rotation).collect(),
        node_scale: hierarchy.rest.iter().map(|t| t.scale).collect(),
        node_weight: node_weight.into(),
        rest_weight: rest_weight.into(),
        instance: instances.instance.into(),
        instance_offset: instances.offset.into(),
        skin: skins.skin.into(),
        skin_joint: skins.joint.into(),
        skin_inverse_bind: skins.inverse_bind.into(),
        channel: animation.channel.into(),
        key_time: animation.key_time.into(),
        key_value: animation.key_value.into(),
        base_colour: materials.base_colour.into(),
        metallic_roughness: materials.metallic_roughness.into(),
        specular_factor: materials.specular_factor.into(),
        emissive: materials.emissive.into(),
        alpha_mode: materials.alpha_mode.into(),
        double_sided: materials.double_sided.into(),
        material_texture: materials.texture.into(),
        texture_transform: materials.transform.into(),
        texture: textures.texture.into(),
        texel: textures.texel.into(),
        camera: cameras.into(),
        light: lights.into(),
    })
}
