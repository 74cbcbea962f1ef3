//! Photon density estimation: the irradiance around a point from its nearest photons
//! (Hašan et al. 2008, section 5).

use super::cover::{Cover, Patch};
use crate::data::Photons;
use crate::node::Error;
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZeroUsize;

/// Photons in a kd-tree.
pub struct Density<'a> {
    photons: &'a Photons,
    tree: Option<ImmutableKdTree<f32, 3>>,
    nearest: NonZeroUsize,
    radius: f32,
}

impl<'a> Density<'a> {
    /// Estimates from the `nearest` photons within `radius` metres.
    ///
    /// # Errors
    /// When a position is not finite.
    pub fn new(photons: &'a Photons, nearest: u32, radius: f32) -> Result<Self, Error> {
        let points: Vec<[f32; 3]> = photons.position.iter().map(Vec3::to_array).collect();
        if points.as_flattened().iter().any(|x| !x.is_finite()) {
            return Err(Error::invalid("a photon's position is not finite"));
        }
        let failed = |e| Error::invalid(format!("the photons cannot be put in a kd-tree: {e:?}"));
        let tree = if points.is_empty() {
            None
        } else {
            Some(ImmutableKdTree::new_from_slice(&points).map_err(failed)?)
        };
        let nearest = NonZeroUsize::new(nearest as usize).unwrap_or(NonZeroUsize::MIN);
        Ok(Density { photons, tree, nearest, radius })
    }

    /// Irradiance, W/m^2, at one of the samples of `cover`: the flux of the nearest photons on that
    /// side over the area of the surface on which they fell. In a corner that is less than the disc
    /// that holds them, and light would be missing. Zero where there are none.
    pub fn irradiance(&self, at: &Patch, cover: &Cover) -> Vec3 {
        let Some(tree) = &self.tree else { return Vec3::ZERO };
        let near = tree
            .query(&at.position.to_array())
            .nearest_n::<SquaredEuclidean<f32>>(self.nearest)
            .within(self.radius * self.radius)
            .execute();
        // The farthest of as many as were asked for only says how large the disc is: counting it too
        // would find k photons where k - 1 are expected.
        let full = near.len() == self.nearest.get() && near.len() > 1;
        let counted = near.len() - usize::from(full);
        let farthest = near.iter().map(|photon| photon.distance).fold(0.0, f32::max);
        // Fewer photons than asked for fill the whole radius; all of them on one spot fill nothing,
        // and a spot of a thousandth of the radius is taken instead of none.
        let squared =
            if near.len() < self.nearest.get() { self.radius * self.radius } else { farthest };
        let least = self.radius * self.radius * 1e-6;
        let squared = squared.max(least);
        let radius = squared.sqrt();
        let flux: Vec3 = near[..counted]
            .iter()
            .map(|photon| photon.item as usize)
            .filter(|&i| at.shares(self.photons.position[i], self.photons.normal[i], radius))
            .map(|i| self.photons.power[i])
            .sum();
        match flux == Vec3::ZERO {
            true => Vec3::ZERO,
            false => flux / cover.area(at, squared).max(f32::MIN_POSITIVE),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::surface_sampling::uniform;
    use std::f32::consts::PI;

    fn plane(count: u32) -> Photons {
        let place = |i| {
            let [u, v, ..] = uniform(i, 0, 1);
            Vec3::new(u - 0.5, 0.0, v - 0.5)
        };
        Photons {
            position: (0..count).map(place).collect(),
            direction: vec![Vec3::NEG_Y; count as usize].into(),
            power: vec![Vec3::new(2.0, 1.0, 0.0) / count as f32; count as usize].into(),
            normal: vec![Vec3::Y; count as usize].into(),
        }
    }

    fn irradiance(photons: &Photons, nearest: u32, radius: f32, normal: Vec3) -> Vec3 {
        let at = Patch { position: Vec3::ZERO, normal, area: 1.0 };
        let density = Density::new(photons, nearest, radius).unwrap();
        density.irradiance(&at, &Cover::new(Vec::new()).unwrap())
    }

    #[test]
    fn uniform_flux_is_uniform_irradiance() {
        let photons = plane(4096);
        let found = irradiance(&photons, 100, 0.4, Vec3::Y);
        assert!((found - Vec3::new(2.0, 1.0, 0.0)).abs().max_element() < 0.1, "{found}");
        assert_eq!(irradiance(&photons, 100, 0.4, Vec3::NEG_Y), Vec3::ZERO);
    }

    #[test]
    fn a_corner_is_as_bright_as_the_middle() {
        let photons = plane(4096);
        let patch = |i| {
            let [u, v, ..] = uniform(i, 5, 1);
            let position = Vec3::new(u - 0.5, 0.0, v - 0.5);
            Patch { position, normal: Vec3::Y, area: 1.0 / 8192.0 }
        };
        let cover = Cover::new((0..8192).map(patch).collect()).unwrap();
        let density = Density::new(&photons, 200, 0.4).unwrap();
        // A single place is off by a tenth or two; many along the middle, an edge and near the corners are not.
        let spread = |k: u32| 0.02 * k as f32 - 0.19;
        let middle = |k| (spread(k), spread(k * 7 % 20));
        let edge = |k| (0.5, spread(k));
        let corner = |k: u32| (0.5 - 0.01 * k as f32, [-0.5, 0.5][k as usize % 2]);
        let places: [&dyn Fn(u32) -> (f32, f32); 3] = [&middle, &edge, &corner];
        for place in places {
            let irradiance = |k| {
                let (x, z) = place(k);
                let at = Patch { position: Vec3::new(x, 0.0, z), ..patch(0) };
                density.irradiance(&at, &cover).x
            };
            let mean = (0..20).map(irradiance).sum::<f32>() / 20.0;
            assert!((mean / 2.0 - 1.0).abs() < 0.06, "{:?}: {mean}", place(0));
        }
    }

    #[test]
    fn no_photons_too_few_or_all_on_one_spot() {
        assert_eq!(irradiance(&plane(0), 10, 1.0, Vec3::Y), Vec3::ZERO);
        let found = irradiance(&plane(3), 1000, 2.0, Vec3::Y);
        assert!((found.x - 2.0 / (PI * 4.0)).abs() < 1e-4, "{found}");
        let mut spot = plane(100);
        spot.position = vec![Vec3::ZERO; 100].into();
        assert!(irradiance(&spot, 10, 1.0, Vec3::Y).is_finite());
    }
}
