//! A list of lights in the making.

use super::element::Light;
use crate::data::Lights;
use glam::{Vec2, Vec3};

/// Lights that are added one after the other.
#[derive(Default)]
pub struct LightList {
    kind: Vec<u8>,
    position: Vec<Vec3>,
    direction: Vec<Vec3>,
    emission: Vec<Vec3>,
    cone: Vec<Vec2>,
    clamp: Vec<f32>,
}

impl LightList {
    /// No lights yet.
    pub fn new() -> Self {
        LightList::default()
    }

    /// Adds a light. What is not finite or negative in its emission becomes zero.
    pub fn push(&mut self, light: &Light) {
        let clean = |x: f32| if x.is_finite() { x.max(0.0) } else { 0.0 };
        self.kind.push(light.kind as u8);
        self.position.push(light.position);
        self.direction.push(light.direction);
        self.emission.push(Vec3::from_array(light.emission.to_array().map(clean)));
        self.cone.push(light.cone);
        self.clamp.push(light.clamp);
    }

    /// Adds light `j` of another list, its emission times `scale`.
    pub fn copy(&mut self, lights: &Lights, j: usize, scale: Vec3) {
        let mut light = Light::at(lights, j);
        light.emission *= scale;
        self.push(&light);
    }

    /// The list as an artifact; `identity` says whether light j means the same in every frame.
    pub fn finish(self, identity: bool) -> Lights {
        Lights {
            kind: self.kind.into(),
            position: self.position.into(),
            direction: self.direction.into(),
            emission: self.emission.into(),
            cone: self.cone.into(),
            clamp: self.clamp.into(),
            identity: u8::from(identity),
        }
    }
}
