//! Where meshes stand: nodes with meshes, EXT_mesh_gpu_instancing, and skins.

use super::accessors::Accessors;
use super::container::Document;
use super::hierarchy::{Hierarchy, unit_rotation};
use super::materials::Materials;
use super::meshes::{Meshes, Summary, row};
use super::notes::Notes;
use crate::data::instance::NO_SKIN;
use crate::node::{Ctx, Error};
use glam::{Mat4, Quat, Vec3};
use serde_json::Value;

/// The instance columns of a scene, and a summary of each mesh of the file that is used.
#[derive(Default)]
pub(super) struct Instances {
    pub(super) instance: Vec<[u32; 3]>,
    pub(super) offset: Vec<[f32; 16]>,
    pub(super) summaries: Vec<Option<Summary>>,
}

/// The skin columns of a scene.
#[derive(Default)]
pub(super) struct Skins {
    pub(super) skin: Vec<[u32; 2]>,
    pub(super) joint: Vec<u32>,
    pub(super) inverse_bind: Vec<[f32; 16]>,
}

impl Skins {
    /// Reads all skins of a file; a missing inverse bind matrix is the identity.
    pub(super) fn read(document: &Document, accessors: &Accessors<'_>) -> Result<Self, Error> {
        let mut skins = Skins::default();
        for (i, skin) in document.skins.iter().enumerate() {
            let wrong = |what: String| Error::invalid(format!("skins[{i}]: {what}"));
            if let Some(missing) =
                skin.joints.iter().find(|joint| joint.value() >= document.nodes.len())
            {
                return Err(wrong(format!("nodes[{missing}] does not exist")));
            }
            let joints = skin.joints.len();
            let mut matrices = match skin.inverse_bind_matrices {
                None => vec![Mat4::IDENTITY.to_cols_array(); joints],
                Some(index) => {
                    let accessor = accessors.open(index.value());
                    accessor
                        .and_then(|a| a.vectors(false, None))
                        .map_err(|e| wrong(e.to_string()))?
                }
            };
            if matrices.len() < joints {
                return Err(wrong(format!(
                    "{} inverse bind matrices for {joints} joints",
                    matrices.len()
                )));
            }
            matrices.truncate(joints);
            skins.skin.push([row(skins.joint.len(), "joints")?, row(joints, "joints")?]);
            skins.joint.extend(skin.joints.iter().map(|joint| joint.value() as u32));
            skins.inverse_bind.extend(matrices);
        }
        Ok(skins)
    }
}

/// The meshes that nodes of the default scene use, and their instances in the order of the nodes.
pub(super) fn read(
    document: &Document,
    accessors: &Accessors<'_>,
    materials: &Materials,
    hierarchy: &Hierarchy,
    (notes, ctx): (&Notes, &Ctx),
) -> Result<(Meshes, Instances), Error> {
    let mut meshes = Meshes::default();
    let mut instances = Instances::default();
    instances.summaries.resize_with(document.meshes.len(), || None);
    let used = |node: usize| document.nodes[node].mesh.map(|mesh| mesh.value());
    let mut order: Vec<usize> = hierarchy.shown.iter().filter_map(|node| used(*node)).collect();
    order.sort_unstable();
    order.dedup();
    let unused = document.meshes.len().saturating_sub(order.len());
    notes.add("meshes that no node of the scene shows left out", unused as u64, "meshes");
    let mut numbers = vec![0; document.meshes.len()];
    let mut number = 0;
    for (done, mesh) in order.iter().enumerate() {
        ctx.tick(done as u64, order.len() as u64)?;
        let summary = meshes.append(document, accessors, materials, notes, (*mesh, number))?;
        numbers[*mesh] = number;
        number += u32::from(summary.drawn);
        instances.summaries[*mesh] = Some(summary);
    }
    for node in &hierarchy.shown {
        let Some((mesh, summary)) =
            used(*node).and_then(|m| Some((m, instances.summaries[m].as_ref()?)))
        else {
            continue;
        };
        if !summary.drawn {
            continue;
        }
        let place = format!("nodes[{node}]");
        let named = |e: Error| Error::invalid(format!("{place}: {e}"));
        let skin = skin(document, *node, summary, notes, &place).map_err(named)?;
        let offsets = offsets(document, accessors, *node).map_err(named)?;
        row(instances.instance.len() + offsets.len(), "instances")?;
        instances.instance.extend(offsets.iter().map(|_| [*node as u32, numbers[mesh], skin]));
        instances.offset.extend(offsets);
    }
    Ok((meshes, instances))
}

fn skin(
    document: &Document,
    node: usize,
    mesh: &Summary,
    notes: &Notes,
    place: &str,
) -> Result<u32, Error> {
    let Some(index) = document.nodes[node].skin else {
        notes.add(
            "skinned meshes on nodes without a skin: shown unskinned",
            u64::from(mesh.joints.is_some()),
            place,
        );
        return Ok(NO_SKIN);
    };
    let wrong = |what: &str| Error::invalid(format!("skins[{index}] {what}"));
    let skin = document.skins.get(index.value()).ok_or_else(|| wrong("does not exist"))?;
    match mesh.joints {
        None => {
            notes.count("skins on meshes without skin weights: shown unskinned", place);
            Ok(NO_SKIN)
        }
        Some(needed) if needed as usize > skin.joints.len() => Err(wrong(&format!(
            "has {} joints, but a vertex needs joint {}",
            skin.joints.len(),
            needed - 1
        ))),
        Some(_) => Ok(index.value() as u32),
    }
}

/// The offsets of a node's instances: the identity, or those of EXT_mesh_gpu_instancing.
fn offsets(
    document: &Document,
    accessors: &Accessors<'_>,
    node: usize,
) -> Result<Vec<[f32; 16]>, Error> {
    let extension = document.nodes[node].extensions.as_ref();
    let Some(instancing) = extension.and_then(|e| e.others.get("EXT_mesh_gpu_instancing")) else {
        return Ok(vec![Mat4::IDENTITY.to_cols_array()]);
    };
    let mut translations: Option<Vec<[f32; 3]>> = None;
    let mut rotations: Option<Vec<[f32; 4]>> = None;
    let mut scales: Option<Vec<[f32; 3]>> = None;
    let attributes = instancing.get("attributes").and_then(Value::as_object);
    for (name, index) in attributes.into_iter().flatten() {
        let wrong =
            |what: String| Error::invalid(format!("EXT_mesh_gpu_instancing {name}: {what}"));
        let index = index.as_u64().and_then(|i| usize::try_from(i).ok());
        let index = index.ok_or_else(|| wrong("expected the number of an accessor".into()))?;
        let named = |e: Error| wrong(e.to_string());
        let accessor = accessors.open(index).map_err(named)?;
        match name.as_str() {
            "TRANSLATION" => translations = Some(accessor.vectors(false, None).map_err(named)?),
            "ROTATION" => rotations = Some(accessor.vectors(true, None).map_err(named)?),
            "SCALE" => scales = Some(accessor.vectors(false, None).map_err(named)?),
            _ => {}
        }
    }
    let counts = [
        translations.as_ref().map(Vec::len),
        rotations.as_ref().map(Vec::len),
        scales.as_ref().map(Vec::len),
    ];
    let count = counts.into_iter().flatten().max().unwrap_or(1);
    if counts.into_iter().flatten().any(|other| other != count) {
        return Err(Error::invalid(format!(
            "EXT_mesh_gpu_instancing: attributes of different lengths {counts:?}"
        )));
    }
    let offset = |i: usize| {
        let translation = translations.as_ref().map_or(Vec3::ZERO, |t| Vec3::from(t[i]));
        let rotation =
            rotations.as_ref().map_or(Quat::IDENTITY, |r| Quat::from_array(unit_rotation(r[i]).0));
        let scale = scales.as_ref().map_or(Vec3::ONE, |s| Vec3::from(s[i]));
        Mat4::from_scale_rotation_translation(scale, rotation, translation).to_cols_array()
    };
    Ok((0..count).map(offset).collect())
}
