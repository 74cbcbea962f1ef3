//! Surfels and directions for tests.

use super::hierarchy::Surfel;
use glam::Vec3;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;

/// Directions with weights that integrate over the sphere, polynomials of degree below `steps` exactly: Fejér's first rule in the polar
/// angle, equal angles around.
pub fn directions(steps: usize) -> Vec<(Vec3, f64)> {
    let mut all = Vec::with_capacity(2 * steps * steps);
    for i in 0..steps {
        let theta = PI * (i as f64 + 0.5) / steps as f64;
        let terms =
            (1..=steps / 2).map(|k| (2.0 * k as f64 * theta).cos() / (4 * k * k - 1) as f64);
        let band = 2.0 / steps as f64 * (1.0 - 2.0 * terms.sum::<f64>());
        for j in 0..2 * steps {
            let phi = PI * (j as f64 + 0.5) / steps as f64;
            let d = [theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()];
            all.push((Vec3::from(d.map(|x| x as f32)), band * PI / steps as f64));
        }
    }
    all
}

/// Unit vectors, uniform over the sphere.
pub fn unit_vectors(count: usize, seed: u64) -> Vec<Vec3> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..count).map(|_| unit(&mut random)).collect()
}

fn unit(random: &mut impl Rng) -> Vec3 {
    loop {
        let v = Vec3::new(random.random(), random.random(), random.random()) * 2.0 - 1.0;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

/// Surfels with random places in a box of this size, random normals, colours and areas.
pub fn cloud(count: usize, size: f32, seed: u64) -> Vec<Surfel> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let spacing = size / (count as f32).sqrt().max(1.0);
    (0..count)
        .map(|_| {
            let area = spacing * spacing * random.random_range(0.5..2.0f32);
            Surfel {
                position: Vec3::new(random.random(), random.random(), random.random()) * size,
                normal: unit(&mut random),
                radiance: Vec3::new(random.random(), random.random(), random.random()),
                area,
                radius: (area / std::f32::consts::PI).sqrt() * random.random_range(1.0..1.5f32),
            }
        })
        .collect()
}

/// Surfels on a sphere of radius 1 that send light outwards, brighter at one side.
pub fn ball(count: usize, seed: u64) -> Vec<Surfel> {
    let area = (4.0 * PI / count as f64) as f32;
    let radius = (area / std::f32::consts::PI).sqrt() * 1.3;
    let shade = |n: Vec3| Vec3::new(n.y.max(0.0), 0.3, 0.1 + 0.1 * n.x);
    let surfel = |n| Surfel { position: n, normal: n, radiance: shade(n), area, radius };
    unit_vectors(count, seed).into_iter().map(surfel).collect()
}
