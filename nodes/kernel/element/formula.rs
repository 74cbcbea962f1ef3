//! The formula of an element, for one pair of receiver and light or for eight side by side.

use super::{Light, Receiver};
use crate::data::LightKind;
use crate::kernel::brdf::ReflectanceLanes;
use crate::kernel::lanes::{Lanes, Real, Triple, WIDTH};
use glam::Vec3;

/// A [`Receiver`], or one a lane. One that is all zero faces no light.
#[derive(Clone, Copy, Debug, Default)]
pub struct ReceiverLanes<R> {
    position: Triple<R>,
    normal: Triple<R>,
    facet: Triple<R>,
    to_eye: Triple<R>,
    reflectance: ReflectanceLanes<R>,
}

/// A [`Light`], or one a lane.
#[derive(Clone, Copy, Debug, Default)]
pub struct LightLanes<R> {
    position: Triple<R>,
    direction: Triple<R>,
    emission: Triple<R>,
    /// Cosines of a spot's inner and outer cone.
    cone: [R; 2],
    clamp: R,
    /// The lanes that emit at all, and those of each kind that is not the same in all directions.
    emits: u32,
    directional: u32,
    cosine: u32,
    spot: u32,
}

/// What comes from a light before the receiver's cosine.
struct Arrival<R> {
    /// Unit vector to the light.
    unit: Triple<R>,
    /// Intensity falloff over distance squared.
    factor: R,
    /// Where anything comes.
    arrives: u32,
}

impl<R: Real> ReceiverLanes<R> {
    /// The same in every lane.
    #[inline(always)]
    pub fn splat(receiver: &Receiver) -> Self {
        let Receiver { position, normal, facet, to_eye, reflectance } = receiver;
        let [position, normal, facet, to_eye] =
            [position, normal, facet, to_eye].map(|v| Triple::splat(*v));
        let reflectance = ReflectanceLanes::splat(reflectance);
        ReceiverLanes { position, normal, facet, to_eye, reflectance }
    }

    /// Where a light can add anything before visibility is asked: it emits, and each is on the other's bright side.
    #[inline(always)]
    pub fn faces(&self, light: &LightLanes<R>) -> u32 {
        self.lit(&self.arrival(light)) & light.emits
    }

    /// Radiance, W/(m^2 sr), that a light adds in the direction of the eye if nothing is between: see
    /// [`element`](super::element).
    #[inline(always)]
    pub fn elements(&self, light: &LightLanes<R>) -> Triple<R> {
        let arrival = self.arrival(light);
        let (lit, dark) = (self.lit(&arrival), Triple::splat(Vec3::ZERO));
        if lit == 0 {
            return dark;
        }
        let cosine = self.normal.dot(arrival.unit);
        let brdf = self.reflectance.brdf(self.normal, self.to_eye, arrival.unit);
        // Bounded twice: an infinite factor times a dark channel would be no number at all.
        let most = R::splat(f32::MAX);
        let reflected = brdf.times(arrival.factor * cosine).at_most(most);
        light.emission.by(reflected).at_most(most).or(lit, dark)
    }

    /// Where what arrives comes from above the surface, by both of its normals.
    #[inline(always)]
    fn lit(&self, arrival: &Arrival<R>) -> u32 {
        let zero = R::splat(0.0);
        arrival.arrives
            & self.normal.dot(arrival.unit).gt(zero)
            & self.facet.dot(arrival.unit).gt(zero)
    }

    #[inline(always)]
    fn arrival(&self, light: &LightLanes<R>) -> Arrival<R> {
        let [zero, one, least] = [0.0, 1.0, f32::MIN_POSITIVE].map(R::splat);
        let to_light = light.position.minus(self.position);
        let squared = to_light.dot(to_light);
        // A light on the sample itself has no direction, and one closer than the square root of the
        // smallest number none that is finite: nothing arrives from it.
        let mut arrives = squared.ge(least);
        let mut unit = to_light.over(squared.sqrt());
        let cosine = light.direction.dot(unit).negated();
        arrives &= cosine.gt(zero) | !light.cosine;
        let mut falloff = cosine.or(light.cosine, one);
        if light.spot != 0 {
            // The square of the linear interpolation of cosines between the cones.
            let [inner, outer] = light.cone;
            let linear = ((cosine - outer) / (inner - outer).max(R::splat(1e-6))).min(one);
            arrives &= cosine.gt(outer) | !light.spot;
            falloff = (linear * linear).or(light.spot, falloff);
        }
        let mut factor = falloff / squared.max(light.clamp * light.clamp).max(least);
        if light.directional != 0 {
            arrives |= light.directional;
            unit = light.direction.negated().or(light.directional, unit);
            factor = one.or(light.directional, factor);
        }
        Arrival { unit, factor, arrives }
    }
}

impl<R: Real> LightLanes<R> {
    /// The same in every lane.
    #[inline(always)]
    pub fn splat(light: &Light) -> Self {
        let all = |flag: bool| if flag { u32::MAX } else { 0 };
        LightLanes {
            position: Triple::splat(light.position),
            direction: Triple::splat(light.direction),
            emission: Triple::splat(light.emission),
            cone: light.cone.to_array().map(R::splat),
            clamp: R::splat(light.clamp),
            emits: all(light.emission != Vec3::ZERO),
            directional: all(light.kind == LightKind::Directional),
            cosine: all(light.kind == LightKind::Cosine),
            spot: all(light.kind == LightKind::Spot),
        }
    }
}

impl ReceiverLanes<[f32; WIDTH]> {
    /// At most eight receivers; lanes without one are all zero.
    pub fn of(receivers: &[Receiver]) -> Self {
        let each = |of: fn(&Receiver) -> Vec3| {
            Triple::of(|lane| receivers.get(lane).map_or(Vec3::ZERO, of))
        };
        ReceiverLanes {
            position: each(|receiver| receiver.position),
            normal: each(|receiver| receiver.normal),
            facet: each(|receiver| receiver.facet),
            to_eye: each(|receiver| receiver.to_eye),
            reflectance: ReflectanceLanes {
                albedo: each(|receiver| receiver.reflectance.albedo),
                specular: each(|receiver| receiver.reflectance.specular),
                roughness: std::array::from_fn(|lane| {
                    receivers.get(lane).map_or(0.0, |receiver| receiver.reflectance.roughness)
                }),
            },
        }
    }

    /// The same in registers.
    #[inline(always)]
    pub fn lanes<L: Lanes>(&self) -> ReceiverLanes<L> {
        ReceiverLanes {
            position: self.position.lanes(),
            normal: self.normal.lanes(),
            facet: self.facet.lanes(),
            to_eye: self.to_eye.lanes(),
            reflectance: ReflectanceLanes {
                albedo: self.reflectance.albedo.lanes(),
                specular: self.reflectance.specular.lanes(),
                roughness: L::load(&self.reflectance.roughness),
            },
        }
    }
}

impl LightLanes<[f32; WIDTH]> {
    /// At most eight lights; lanes without one emit nothing.
    pub fn of(lights: &[Light]) -> Self {
        let each =
            |of: fn(&Light) -> Vec3| Triple::of(|lane| lights.get(lane).map_or(Vec3::ZERO, of));
        let number =
            |of: fn(&Light) -> f32| std::array::from_fn(|lane| lights.get(lane).map_or(0.0, of));
        let mask = |of: &dyn Fn(&Light) -> bool| {
            lights
                .iter()
                .enumerate()
                .fold(0, |mask, (lane, light)| mask | u32::from(of(light)) << lane)
        };
        let kind = |kind: LightKind| mask(&|light| light.kind == kind);
        LightLanes {
            position: each(|light| light.position),
            direction: each(|light| light.direction),
            emission: each(|light| light.emission),
            cone: [number(|light| light.cone.x), number(|light| light.cone.y)],
            clamp: number(|light| light.clamp),
            emits: mask(&|light| light.emission != Vec3::ZERO),
            directional: kind(LightKind::Directional),
            cosine: kind(LightKind::Cosine),
            spot: kind(LightKind::Spot),
        }
    }

    /// The same in registers.
    #[inline(always)]
    pub fn lanes<L: Lanes>(&self) -> LightLanes<L> {
        let LightLanes { emits, directional, cosine, spot, .. } = *self;
        LightLanes {
            position: self.position.lanes(),
            direction: self.direction.lanes(),
            emission: self.emission.lanes(),
            cone: [L::load(&self.cone[0]), L::load(&self.cone[1])],
            clamp: L::load(&self.clamp),
            emits,
            directional,
            cosine,
            spot,
        }
    }
}
