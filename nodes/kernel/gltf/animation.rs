//! One animation: its channels, key times and key values.

use super::accessors::Accessors;
use super::container::Document;
use super::hierarchy::unit_rotation;
use super::instances::Instances;
use super::meshes::row;
use super::notes::Notes;
use crate::data::channel;
use crate::node::Error;
use gltf::json;
use gltf::json::animation::{Interpolation, Property};
use gltf::json::validation::Checked;

/// The animation columns of a scene.
#[derive(Default)]
pub(super) struct Animation {
    pub(super) channel: Vec<[u32; 6]>,
    pub(super) key_time: Vec<f32>,
    pub(super) key_value: Vec<f32>,
}

impl Animation {
    /// Reads the document's chosen animation; empty when there is none.
    pub(super) fn read(
        document: &Document,
        accessors: &Accessors<'_>,
        instances: &Instances,
        notes: &Notes,
    ) -> Result<Self, Error> {
        let mut animation = Animation::default();
        let channels = document
            .animation
            .iter()
            .flat_map(|found| found.channels.iter().map(move |c| (found, c)));
        for (i, (found, channel)) in channels.enumerate() {
            let place = format!("animation channel {i}");
            let named = |e: Error| Error::invalid(format!("{place}: {e}"));
            let Checked::Valid(property) = channel.target.path else {
                notes.count("animation channels of unknown properties left out", &place);
                continue;
            };
            let node = channel.target.node.value();
            let Some(target) = document.nodes.get(node) else {
                return Err(named(Error::invalid(format!("nodes[{node}] does not exist"))));
            };
            let summary =
                target.mesh.and_then(|mesh| instances.summaries.get(mesh.value())?.as_ref());
            let targets = summary.map_or(0, |s| s.targets);
            if property == Property::MorphTargetWeights && targets == 0 {
                notes.count(
                    "animation channels of the weights of no morph targets left out",
                    &place,
                );
                continue;
            }
            let sampler = found.samplers.get(channel.sampler.value());
            let sampler =
                sampler.ok_or_else(|| named(Error::invalid("its sampler does not exist")))?;
            animation
                .append(accessors, sampler, (node as u32, property, targets))
                .map_err(named)?;
        }
        Ok(animation)
    }

    fn append(
        &mut self,
        accessors: &Accessors<'_>,
        sampler: &json::animation::Sampler,
        (node, property, targets): (u32, Property, usize),
    ) -> Result<(), Error> {
        let Checked::Valid(interpolation) = sampler.interpolation else {
            return Err(Error::invalid("the interpolation is unknown"));
        };
        let times = accessors.open(sampler.input.value())?.vectors::<1>(false, None)?;
        let times = times.as_flattened();
        if !times.is_sorted_by(|a, b| a < b) {
            return Err(Error::invalid(format!(
                "the times in accessors[{}] do not increase",
                sampler.input
            )));
        }
        let output = accessors.open(sampler.output.value())?;
        let (path, mut values) = match property {
            Property::Translation => {
                (channel::TRANSLATION, output.vectors::<3>(false, None)?.into_flattened())
            }
            Property::Scale => (channel::SCALE, output.vectors::<3>(false, None)?.into_flattened()),
            Property::Rotation => {
                (channel::ROTATION, output.vectors::<4>(true, None)?.into_flattened())
            }
            Property::MorphTargetWeights => {
                (channel::WEIGHTS, output.vectors::<1>(true, None)?.into_flattened())
            }
        };
        let cubic = interpolation == Interpolation::CubicSpline;
        let width = match property {
            Property::Rotation => 4,
            Property::MorphTargetWeights => targets,
            Property::Translation | Property::Scale => 3,
        };
        let expected = times.len().checked_mul(width * if cubic { 3 } else { 1 });
        if expected != Some(values.len()) || times.is_empty() {
            let found = format!(
                "{} keys and {} numbers, of which {width} make a value",
                times.len(),
                values.len()
            );
            return Err(Error::invalid(format!("{found} with {interpolation:?} interpolation")));
        }
        if property == Property::Rotation && !cubic {
            for rotation in values.as_chunks_mut::<4>().0 {
                *rotation = unit_rotation(*rotation).0;
            }
        }
        let interpolation = match interpolation {
            Interpolation::Step => channel::STEP,
            Interpolation::Linear => channel::LINEAR,
            Interpolation::CubicSpline => channel::CUBIC,
        };
        let (first_key, first_value) =
            (row(self.key_time.len(), "keys")?, row(self.key_value.len(), "key values")?);
        self.channel.push([
            node,
            path,
            interpolation,
            first_key,
            row(times.len(), "keys")?,
            first_value,
        ]);
        self.key_time.extend_from_slice(times);
        self.key_value.append(&mut values);
        Ok(())
    }
}

/// Morph weights at rest of every node: the ranges, and the weights.
pub(super) fn rest_weights(
    document: &Document,
    instances: &Instances,
) -> Result<(Vec<[u32; 2]>, Vec<f32>), Error> {
    let mut ranges = Vec::new();
    let mut weights = Vec::new();
    for (i, node) in document.nodes.iter().enumerate() {
        let mesh = node.mesh.map_or(usize::MAX, |mesh| mesh.value());
        let targets =
            instances.summaries.get(mesh).and_then(Option::as_ref).map_or(0, |s| s.targets);
        ranges.push([row(weights.len(), "morph weights")?, row(targets, "morph weights")?]);
        let of_mesh = document.meshes.get(mesh).and_then(|mesh| mesh.weights.as_ref());
        let given = node.weights.as_ref().or(of_mesh).map_or(&[][..], Vec::as_slice);
        if !given.iter().all(|w| w.is_finite()) {
            return Err(Error::invalid(format!(
                "nodes[{i}] has morph weights that are not finite"
            )));
        }
        weights.extend(given.iter().copied().chain(std::iter::repeat(0.0)).take(targets));
    }
    Ok((ranges, weights))
}
