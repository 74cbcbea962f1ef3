//! Cameras and punctual lights of the default scene, in the order of their nodes.

use super::container::Document;
use super::hierarchy::Hierarchy;
use super::notes::Notes;
use crate::node::Error;
use gltf::json;
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use gltf::json::validation::Checked;
use std::f32::consts::{FRAC_PI_2, PI};

/// Narrowest outer cone, and the least part of it by which the inner one is narrower.
const NARROWEST: f32 = 1e-3;

/// The camera column of a scene.
pub(super) fn cameras(document: &Document, hierarchy: &Hierarchy) -> Result<Vec<[f32; 5]>, Error> {
    let mut cameras = Vec::new();
    for node in &hierarchy.shown {
        let Some(index) = document.nodes[*node].camera else { continue };
        let wrong = |what: &str| Error::invalid(format!("cameras[{index}] {what}"));
        let camera = document.cameras.get(index.value()).ok_or_else(|| wrong("does not exist"))?;
        let columns =
            projection(camera).ok_or_else(|| wrong("has no projection, or one that is empty"))?;
        let [angle, half, near, far] = columns;
        cameras.push([*node as f32, angle, half, near, far]);
    }
    Ok(cameras)
}

/// Vertical field of view, half height, near and far.
fn projection(camera: &json::Camera) -> Option<[f32; 4]> {
    let columns = match (camera.type_, &camera.perspective, &camera.orthographic) {
        (Checked::Valid(json::camera::Type::Perspective), Some(p), _) => {
            let valid = p.yfov > 0.0 && p.yfov < PI && p.znear > 0.0;
            valid.then_some([p.yfov, 0.0, p.znear, p.zfar.unwrap_or(f32::MAX)])
        }
        (Checked::Valid(json::camera::Type::Orthographic), _, Some(o)) => {
            // Only the sign of a half height can turn the picture over, which no writer means.
            let valid = o.ymag != 0.0 && o.znear >= 0.0;
            valid.then_some([0.0, o.ymag.abs(), o.znear, o.zfar])
        }
        _ => None,
    }?;
    (columns.iter().all(|v| v.is_finite()) && columns[2] < columns[3]).then_some(columns)
}

/// The light column of a scene. Intensities are taken one to one as W/sr and W/m^2; lights that
/// are not spots have both cosines at 0, their range is ignored.
pub(super) fn lights(
    document: &Document,
    hierarchy: &Hierarchy,
    notes: &Notes,
) -> Result<Vec<[f32; 7]>, Error> {
    let mut lights = Vec::new();
    for node in &hierarchy.shown {
        let extension = document.nodes[*node].extensions.as_ref();
        let Some(reference) = extension.and_then(|e| e.khr_lights_punctual.as_ref()) else {
            continue;
        };
        let place = format!("lights[{}]", reference.light);
        let wrong = |what: &str| Error::invalid(format!("{place} {what}"));
        let light =
            document.lights.get(reference.light.value()).ok_or_else(|| wrong("does not exist"))?;
        let power = light.color.map(|c| c * light.intensity);
        if !power.iter().all(|p| p.is_finite() && *p >= 0.0) {
            return Err(wrong("has an intensity that is negative or not finite"));
        }
        notes.add("light ranges ignored", u64::from(light.range.is_some()), &place);
        let (kind, [inner, outer]) = match light.type_ {
            Checked::Valid(Type::Point) => (0.0, [0.0; 2]),
            Checked::Valid(Type::Spot) => {
                (1.0, cone(light, notes, &place).ok_or_else(|| wrong("has no cone"))?)
            }
            Checked::Valid(Type::Directional) => (2.0, [0.0; 2]),
            Checked::Invalid => return Err(wrong("is of an unknown kind")),
        };
        lights.push([*node as f32, kind, power[0], power[1], power[2], inner, outer]);
    }
    Ok(lights)
}

/// Cosines of the inner and the outer cone, the inner one strictly narrower.
fn cone(light: &Light, notes: &Notes, place: &str) -> Option<[f32; 2]> {
    let spot = light.spot.as_ref()?;
    if !spot.inner_cone_angle.is_finite() || !spot.outer_cone_angle.is_finite() {
        return None;
    }
    let outer = spot.outer_cone_angle.clamp(NARROWEST, FRAC_PI_2);
    let inner = spot.inner_cone_angle.clamp(0.0, outer * (1.0 - NARROWEST));
    let repaired = outer != spot.outer_cone_angle || inner != spot.inner_cone_angle;
    notes.add("spot cones repaired", u64::from(repaired), place);
    Some([f64::from(inner).cos() as f32, f64::from(outer).cos() as f32])
}
