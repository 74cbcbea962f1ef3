//! Surfels: Poisson-disk samples of triangles (Buchholz and Boubekeur 2012, section 3), by weighted sample elimination
//! (Yuksel 2015), which gives exactly as many as wanted.

mod elimination;
mod grid;

use crate::kernel::surface_sampling;
use glam::{DVec3, Vec2, Vec3};
use grid::{Grid, Live};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Candidates for each sample.
const CANDIDATES: u32 = 5;

/// Samples of a surface, each standing for the same area.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// The triangle of each, ascending.
    pub triangle: Vec<u32>,
    /// Barycentric weights of the second and third corner of each.
    pub barycentric: Vec<Vec2>,
    /// Radius of the disc each is drawn as, world units: reaches all of the surface that is nearer to it than to other samples
    /// (up to the density of the candidates), so that discs leave no holes. At least that of the disc of `area`.
    pub splat: Vec<f32>,
    /// Area each stands for, square world units: that of all triangles over the number of samples.
    pub area: f32,
    /// Half the distance of the two nearest samples on the same side, world units: discs of this radius do not overlap. At most
    /// that of the densest packing.
    pub radius: f32,
}

/// `wanted` samples of `count` triangles, given by their corners; none if the triangles have no area. The fewer there are beside
/// `wanted`, the better: the samples keep apart across edges of triangles. Triangles without area, or with corners that are not
/// finite, have none. Samples whose facets face apart (the two sides of a thin wall) do not see each other.
pub fn sample(
    triangles: impl Fn(u32) -> [Vec3; 3] + Sync,
    count: u32,
    wanted: u32,
    seed: u64,
) -> Samples {
    let areas: Vec<f64> = (0..count).into_par_iter().map(|t| area(triangles(t))).collect();
    let total: f64 = areas.iter().sum();
    if wanted == 0 || !(total > 0.0 && total.is_finite()) {
        return Samples::default();
    }
    let points = surface_sampling::sample(&areas, wanted.saturating_mul(CANDIDATES), seed);
    // Twice the radius of the densest packing is the length within which samples see each other.
    let reach = 2.0 * (total / (f64::from(wanted) * 2.0 * 3f64.sqrt())).sqrt();
    let corners = |(t, &area): (usize, &f64)| match area > 0.0 {
        true => triangles(t as u32).map(Vec3::as_dvec3).into_iter().reduce(DVec3::min),
        false => None,
    };
    let least = areas.par_iter().enumerate().filter_map(corners);
    let origin = least.reduce(|| DVec3::INFINITY, DVec3::min);
    let grid = Grid::new(place(&triangles, &points, origin, reach));
    let live = elimination::eliminate(&grid, wanted as usize);
    let (holes, apart) = spacing(&grid, &live);
    let item = |slot: &u32| grid.item[*slot as usize];
    let mut order: Vec<(u32, f32)> = live.slots.iter().map(item).zip(holes).collect();
    order.sort_unstable_by_key(|&(point, _)| point);
    let area = total / f64::from(wanted);
    let disc = (area / PI).sqrt();
    // Between candidates lies half their spacing that none of them measured.
    let unseen = disc / f64::from(CANDIDATES).sqrt();
    let splat = |hole: f32| (f64::from(hole) * reach + unseen).max(disc) as f32;
    Samples {
        triangle: order.iter().map(|&(i, _)| points[i as usize].triangle).collect(),
        barycentric: order.iter().map(|&(i, _)| points[i as usize].barycentric).collect(),
        splat: order.iter().map(|&(_, hole)| splat(hole)).collect(),
        area: area as f32,
        radius: (0.5 * f64::from(apart) * reach) as f32,
    }
}

/// Zero where a corner is not finite.
fn area([a, b, c]: [Vec3; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
    let area = 0.5 * (b - a).cross(c - a).length();
    if area.is_finite() { area } else { 0.0 }
}

/// A candidate in units of the reach, from the least corner of all.
#[derive(Clone, Copy, Debug)]
struct Place {
    position: Vec3,
    normal: Vec3,
}

fn place(
    triangles: &(impl Fn(u32) -> [Vec3; 3] + Sync),
    points: &[surface_sampling::Point],
    origin: DVec3,
    reach: f64,
) -> Vec<Place> {
    let world = |point: &surface_sampling::Point| {
        let [a, b, c] = triangles(point.triangle).map(Vec3::as_dvec3);
        let [u, v] = point.barycentric.as_dvec2().to_array();
        (a + (b - a) * u + (c - a) * v, (b - a).cross(c - a).normalize_or_zero())
    };
    let place = |point| {
        let (position, normal) = world(point);
        Place { position: ((position - origin) / reach).as_vec3(), normal: normal.as_vec3() }
    };
    points.par_iter().map(place).collect()
}

/// For each live candidate the distance of the farthest candidate to which it is nearest, and the least distance of two of them; both
/// in units of the reach, the second at most 1.
fn spacing(grid: &Grid, live: &Live) -> (Vec<f32>, f32) {
    let of_cell = |cell: u32| {
        // Looked up once for all candidates of the cell.
        let around: Vec<u32> = live.around(grid, cell).collect();
        let nearest = move |slot: u32| {
            let mut nearest = (u32::MAX, 1.0);
            for &other in &around {
                if live.slots[other as usize] != slot
                    && let Some(distance) = grid.distance(slot, live.slots[other as usize])
                    && distance < nearest.1
                {
                    nearest = (other, distance);
                }
            }
            nearest
        };
        (grid.start[cell as usize]..grid.start[cell as usize + 1]).map(nearest)
    };
    let cells = 0..grid.start.len() as u32 - 1;
    let nearest: Vec<(u32, f32)> = cells.into_par_iter().flat_map_iter(of_cell).collect();
    let mut holes = vec![0f32; live.slots.len()];
    let mut apart = 1.0f32;
    let mut own = live.slots.iter().peekable();
    for (slot, &(other, distance)) in (0..).zip(&nearest) {
        if own.next_if(|&&own| own == slot).is_some() {
            apart = apart.min(distance);
        } else if let Some(hole) = holes.get_mut(other as usize) {
            *hole = hole.max(distance);
        }
    }
    (holes, apart)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of two triangles in the plane y = `height`, `side` wide, facing up or down.
    fn square(height: f32, side: f32, up: bool) -> [[Vec3; 3]; 2] {
        let at = |x, z| Vec3::new(x * side, height, z * side);
        let [a, b, c, d] = [at(0.0, 0.0), at(0.0, 1.0), at(1.0, 1.0), at(1.0, 0.0)];
        if up { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] }
    }

    fn of(triangles: &[[Vec3; 3]], wanted: u32, seed: u64) -> Samples {
        sample(|t| triangles[t as usize], triangles.len() as u32, wanted, seed)
    }

    fn place(triangles: &[[Vec3; 3]], triangle: u32, [u, v]: [f32; 2]) -> Vec3 {
        let [a, b, c] = triangles[triangle as usize];
        a + (b - a) * u + (c - a) * v
    }

    fn places(triangles: &[[Vec3; 3]], samples: &Samples) -> Vec<Vec3> {
        let points = samples.triangle.iter().zip(&samples.barycentric);
        points.map(|(&t, b)| place(triangles, t, b.to_array())).collect()
    }

    fn least_distance(places: &[Vec3]) -> f32 {
        let from = |i: usize| places[..i].iter().map(move |p| p.distance(places[i]));
        (0..places.len()).flat_map(from).fold(f32::INFINITY, f32::min)
    }

    #[test]
    fn exactly_as_many_as_wanted_and_far_apart() {
        let triangles = square(0.0, 2.0, true);
        let densest = |n: f32| 2.0 * (4.0 / (n * 2.0 * 3f32.sqrt())).sqrt();
        for wanted in [1, 2, 3, 10, 100, 3000] {
            let samples = of(&triangles, wanted, 1);
            assert_eq!(samples.triangle.len(), wanted as usize);
            assert_eq!(samples.area, 4.0 / wanted as f32);
            assert!(samples.triangle.is_sorted());
        }
        let samples = of(&triangles, 3000, 1);
        let apart = least_distance(&places(&triangles, &samples)) / densest(3000.0);
        let random = surface_sampling::sample(&[2.0, 2.0], 3000, 1);
        let random: Vec<Vec3> = random
            .iter()
            .map(|p| place(&triangles, p.triangle, p.barycentric.to_array()))
            .collect();
        assert!(apart > 0.58, "{apart} of the densest packing");
        assert!(apart > 5.0 * least_distance(&random) / densest(3000.0));
        assert!((2.0 * samples.radius / densest(3000.0) - apart).abs() < 1e-3);
    }

    #[test]
    fn discs_leave_no_holes() {
        let triangles = square(0.0, 1.0, true);
        // Enough to be eliminated in several blocks.
        let samples = of(&triangles, 6000, 3);
        let places = places(&triangles, &samples);
        let open = (0..20_000)
            .map(|i| surface_sampling::uniform(i, 5, 9))
            .filter(|[x, z, ..]| {
                let at = Vec3::new(*x, 0.0, *z);
                !places.iter().zip(&samples.splat).any(|(p, &r)| p.distance_squared(at) <= r * r)
            })
            .count();
        assert!(open < 20, "{open} of 20000 places are in no disc");
        let covered: f64 = samples.splat.iter().map(|&r| PI * f64::from(r).powi(2)).sum();
        assert!(covered < 3.5, "discs are {covered} times the surface");
    }

    #[test]
    fn both_sides_of_a_thin_wall_are_sampled_alike() {
        let triangles = [square(0.0, 1.0, false), square(1e-5, 1.0, true)].concat();
        let samples = of(&triangles, 2000, 1);
        let below = samples.triangle.iter().filter(|&&t| t < 2).count();
        assert!((940..=1060).contains(&below), "{below} of 2000");
        let places = places(&triangles, &samples);
        let one_sheet = least_distance(&places[..below]);
        assert!(one_sheet > 1.7 * samples.radius, "{one_sheet}");
        assert!(least_distance(&places) < 0.5 * one_sheet, "the sides do not see each other");
    }

    #[test]
    fn layers_at_one_place_are_sampled_as_one_sheet() {
        let triangles = [square(0.0, 1.0, true); 10].concat();
        let samples = of(&triangles, 2000, 1);
        assert_eq!(samples.triangle.len(), 2000);
        let densest = 2.0 * (1.0 / (2000.0 * 2.0 * 3f32.sqrt())).sqrt();
        let apart = least_distance(&places(&triangles, &samples)) / densest;
        assert!(apart > 0.45, "{apart} of the densest packing of one sheet");
    }

    #[test]
    fn what_has_no_area_is_never_sampled() {
        let mut triangles = square(0.0, 1.0, true).to_vec();
        let [a, b, _] = triangles[0];
        triangles.extend([[a, a, a], [a, b, b.lerp(a, 0.5)], [a, b, Vec3::NAN]]);
        triangles.push([a, b, Vec3::splat(f32::INFINITY)]);
        let samples = of(&triangles, 500, 1);
        assert_eq!(samples.triangle.len(), 500);
        assert!(samples.triangle.iter().all(|&t| t < 2));
        for (triangles, wanted) in [(&triangles[2..], 10), (&triangles[..], 0), (&[], 5)] {
            assert_eq!(of(triangles, wanted, 1), Samples::default());
        }
    }

    #[test]
    fn density_follows_area_over_triangles_of_all_sizes() {
        // A fan of ever thinner triangles, and the same triangle ten times over.
        let fan = |i: u32| {
            let x = |i: u32| 1.0 - 0.5f32.powi(i as i32);
            [Vec3::new(x(i), 0.0, 0.0), Vec3::Z, Vec3::new(x(i + 1), 0.0, 0.0)]
        };
        let mut triangles: Vec<_> = (0..12).map(fan).collect();
        let samples = of(&triangles, 4000, 1);
        let first = samples.triangle.iter().filter(|&&t| t == 0).count();
        assert!((1920..2080).contains(&first), "half the area, {first} of 4000 samples");
        triangles = vec![triangles[0]; 10];
        assert_eq!(of(&triangles, 1000, 1).triangle.len(), 1000);
    }

    #[test]
    fn scale_and_place_do_not_matter() {
        let plain = square(0.0, 1.0, true);
        let moved = |scale: f32, by: f32| plain.map(|t| t.map(|p| p * scale + Vec3::splat(by)));
        let samples = of(&plain, 300, 1);
        for (scale, by) in [(2f32.powi(-20), 0.0), (2f32.powi(20), 0.0), (1.0, 2f32.powi(20))] {
            let found = of(&moved(scale, by), 300, 1);
            assert_eq!(found.barycentric, samples.barycentric);
            assert!((found.radius / scale / samples.radius - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let triangles = [square(0.0, 1.0, true), square(1.0, 3.0, false)].concat();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| of(&triangles, 3000, 4))
        };
        assert_eq!(run(1), run(2));
        assert_eq!(run(1), run(5));
        assert_ne!(run(1), of(&triangles, 3000, 5));
    }
}
