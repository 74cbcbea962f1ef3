//! Radiance against closed forms, through the nodes.

use super::scenes::{Frame, lamp, lights, look, materials, plane, quad, sphere};
use glam::{DVec3, Vec2, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{Array, Environment, Image, LightKind, Lights};
use nodes::kernel::element::Light;
use nodes::node::{Ctx, Item, Node};
use std::f64::consts::PI;

const ALBEDO: Vec3 = Vec3::new(0.8, 0.5, 0.2);
const SIZE: [u32; 2] = [16, 9];
/// The camera stands this high over the plane and sees a tangent of 0.5 up and down.
const HEIGHT: f64 = 4.0;

fn over_plane() -> Frame {
    let camera = look(Vec3::Y * HEIGHT as f32, Vec3::ZERO, 0.5);
    Frame::still(plane(40.0), materials(&[(ALBEDO, Vec3::ZERO)]), camera, SIZE)
}

/// The point of the plane at the centre of pixel (x, y): the picture's top is at -z, its right at +x.
fn seen(x: u32, y: u32) -> DVec3 {
    let [width, height] = SIZE.map(f64::from);
    let across = (2.0 * (f64::from(x) + 0.5) - width) / height * 0.5 * HEIGHT;
    let down = (2.0 * (f64::from(y) + 0.5) - height) / height * 0.5 * HEIGHT;
    DVec3::new(across, 0.0, down)
}

fn near(found: Vec3, expected: DVec3, tolerance: f64, what: &str) {
    let off = (found.as_dvec3() - expected).abs().max_element() / expected.max_element().max(1e-30);
    assert!(
        off <= tolerance,
        "{what}: {found} where {expected} was expected, {:.3} % off",
        100.0 * off
    );
}

/// Every pixel of the plane lit by one light, against its irradiance.
fn check_plane(light: Light, tolerance: f64, irradiance: impl Fn(DVec3) -> f64) {
    let image = over_plane().reference(&lights(&[light]));
    let mut brightest = 0.0_f64;
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let expected = irradiance(seen(x, y));
            brightest = brightest.max(expected);
            let radiance = (ALBEDO * light.emission).as_dvec3() / PI * expected;
            let found = image.radiance[(y * SIZE[0] + x) as usize];
            near(found, radiance, tolerance, &format!("pixel {x}, {y}"));
        }
    }
    assert!(brightest > 0.0);
}

#[test]
fn a_point_light_falls_off_with_the_square() {
    let place = DVec3::new(0.7, 1.3, -0.4);
    let light = lamp(LightKind::Omni, place.as_vec3(), Vec3::Y, Vec3::new(3.0, 2.0, 1.0));
    check_plane(light, 1e-4, |p| {
        let to = place - p;
        to.y / to.length().powi(3)
    });
}

#[test]
fn a_spot_falls_off_between_its_cones() {
    let (place, axis) = (DVec3::new(-0.5, 1.5, 0.2), DVec3::new(0.3, -1.0, 0.1).normalize());
    let cone = Vec2::new(0.95, 0.8);
    let light = Light {
        cone,
        ..lamp(LightKind::Spot, place.as_vec3(), axis.as_vec3(), Vec3::new(5.0, 4.0, 3.0))
    };
    let (mut inside, mut between, mut outside) = (0, 0, 0);
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let cosine = (seen(x, y) - place).normalize().dot(axis);
            *if cosine > 0.95 {
                &mut inside
            } else if cosine > 0.8 {
                &mut between
            } else {
                &mut outside
            } += 1;
        }
    }
    assert!(inside > 3 && between > 3 && outside > 3, "{inside} {between} {outside}");
    // At the outer cone the ramp is the square of a small difference of cosines.
    check_plane(light, 5e-3, |p| {
        let to = place - p;
        let ramp = ((-to.normalize().dot(axis) - 0.8) / 0.15).clamp(0.0, 1.0);
        ramp * ramp * to.y / to.length().powi(3)
    });
}

#[test]
fn parallel_rays_fall_with_the_cosine() {
    let along = DVec3::new(0.4, -0.7, 0.2).normalize();
    let light = lamp(LightKind::Directional, Vec3::ZERO, along.as_vec3(), Vec3::new(2.0, 1.0, 4.0));
    check_plane(light, 1e-4, |_| -along.y);
}

/// Irradiance under unit radiance from a polygon, at a point with a normal (Lambert).
fn polygon_irradiance(corners: &[DVec3], at: DVec3, normal: DVec3) -> f64 {
    let towards: Vec<DVec3> = corners.iter().map(|c| (*c - at).normalize()).collect();
    let edge = |i: usize| {
        let (a, b) = (towards[i], towards[(i + 1) % towards.len()]);
        a.dot(b).acos() * a.cross(b).normalize().dot(normal)
    };
    (0..towards.len()).map(edge).sum::<f64>().abs() / 2.0
}

#[test]
fn a_quad_light_gives_the_irradiance_of_a_rectangle() {
    let emitted = Vec3::new(4.0, 2.0, 1.0);
    let (low, u, v) = (Vec3::new(-0.5, 1.0, -0.4), Vec3::X, Vec3::Z * 0.8);
    let corners = [low, low + u, low + u + v, low + v].map(|c| c.as_dvec3());
    for at in [Vec3::ZERO, low * Vec3::new(1.0, 0.0, 1.0), Vec3::new(1.2, 0.0, 0.3)] {
        let mut triangles = plane(8.0);
        triangles.extend(quad(low, u, v, 1));
        let surfaces = materials(&[(ALBEDO, Vec3::ZERO), (Vec3::ZERO, emitted)]);
        // One pixel, seen from straight above, below the light.
        let frame = Frame::still(triangles, surfaces, look(at + Vec3::Y * 0.5, at, 0.1), [1, 1]);
        let image = frame.reference(&frame.emissive(16_384).into());
        let irradiance = polygon_irradiance(&corners, at.as_dvec3(), DVec3::Y);
        let expected = (ALBEDO * emitted).as_dvec3() / PI * irradiance;
        near(image.radiance[0], expected, 5e-3, &format!("below {at}"));
    }
}

fn environment_lights(width: usize, height: usize, radiance: Vec<Vec3>, count: u32) -> Lights {
    let environment = Environment { radiance: Array::shaped(radiance, &[height, width]) }.into();
    let input = nodes::EnvironmentLightsIn { environment };
    nodes::EnvironmentLights { count, seed: 1 }.run(input, &Ctx::default()).unwrap()
}

#[test]
fn under_a_constant_sky_a_plane_has_its_albedo() {
    let sky = Vec3::new(0.5, 1.0, 3.0);
    let image = over_plane().reference(&environment_lights(8, 4, vec![sky; 32], 4096).into());
    let check = |p: &Vec3| near(*p, (ALBEDO * sky).as_dvec3(), 5e-3, "a pixel");
    image.radiance.iter().for_each(check);
}

/// A sky that is bright above and dark below the horizon gives the same as one that is bright all over.
#[test]
fn what_is_below_the_horizon_adds_nothing() {
    let mut half = vec![Vec3::ONE; 32];
    half[16..].fill(Vec3::ZERO);
    let frame = over_plane();
    let whole = frame.reference(&environment_lights(8, 4, vec![Vec3::ONE; 32], 4096).into());
    let above = frame.reference(&environment_lights(8, 4, half, 4096).into());
    whole
        .radiance
        .iter()
        .zip(&*above.radiance)
        .for_each(|(w, a)| near(*w, a.as_dvec3(), 5e-3, "a pixel"));
}

const GLOW: Vec3 = Vec3::new(1.0, 2.0, 0.5);
const GREY: Vec3 = Vec3::new(0.6, 0.3, 0.5);

/// Inside of a glowing sphere, seen from its centre. All the walls of a closed convex space see nothing
/// but walls, so any tessellation has the radiance of the furnace; only sampling errs.
fn furnace() -> Frame {
    let camera = look(Vec3::ZERO, Vec3::new(0.3, 0.2, 1.0), 0.8);
    Frame::still(sphere(4), materials(&[(GREY, GLOW)]), camera, [6, 4])
}

/// Mean of an image.
fn mean(image: &Image) -> Vec3 {
    let sum: DVec3 = image.radiance.iter().map(|p| p.as_dvec3()).sum();
    (sum / image.radiance.len() as f64).as_vec3()
}

#[test]
fn a_furnace_is_as_bright_as_its_orders_of_reflection() {
    let frame = furnace();
    let emissive: Item<Lights> = frame.emissive(8192).into();
    // The walls' own light and what they reflect of it once: e (1 + rho), at every pixel.
    let once = frame.reference(&emissive);
    for pixel in once.radiance.iter() {
        near(*pixel, (GLOW * (GREY + 1.0)).as_dvec3(), 5e-3, "one reflection");
    }
    // Clamping does nothing: only one pair in a thousand is near enough, and none is a spike.
    let clamp = vec![0.0; emissive.kind.len()].into();
    let unbounded = frame.reference(&Lights { clamp, ..(*emissive).clone() }.into());
    near(mean(&unbounded), mean(&once).as_dvec3(), 1e-3, "without a clamp");
    // Photons leave a light wherever they land: rho^2 e, rho^3 e and so on. A photon lands a
    // geometrically distributed number of times, so that 32,768 of them err by about 0.5 %; 1 % of the
    // higher orders is 0.5 % of all.
    let photons: Item<Lights> = frame.photon_lights(&emissive, 32_768).into();
    let higher = frame.reference(&photons);
    let orders = GLOW * GREY * GREY / (Vec3::ONE - GREY);
    near(mean(&higher) - GLOW, orders.as_dvec3(), 1e-2, "higher orders by photon lights");
    let all = mean(&once) + mean(&higher) - GLOW;
    near(all, (GLOW / (Vec3::ONE - GREY)).as_dvec3(), 5e-3, "all orders");
}

#[test]
fn gather_lights_fill_a_furnace_from_photons() {
    let frame = furnace();
    let emissive: Item<Lights> = frame.emissive(8192).into();
    let once = mean(&frame.reference(&emissive));
    let samples = frame.gather_samples(4096).unwrap().into();
    let orders = (GLOW * GREY * GREY / (Vec3::ONE - GREY)).as_dvec3();
    // Photons err by half a percent, and as much is missed of light that grazes the bend of the wall
    // within the radius. 10,000 are more than the radius ever holds: the whole disc is used. The disc up
    // to the 50th nearest is too small for 50 by one part in 49.
    for (nearest, tolerance) in [(10_000, 1e-2), (50, 2e-2)] {
        let photons = frame.photons(None, Some(&emissive), 32_768);
        let gathered = frame.gather_lights(&samples, None, Some(photons), nearest);
        let higher = mean(&frame.reference(&gathered.into())) - GLOW;
        near(higher, orders, tolerance, &format!("higher orders from {nearest} photons"));
        near(once + higher, (GLOW / (Vec3::ONE - GREY)).as_dvec3(), 0.5 * tolerance, "all orders");
    }
}

/// A lamp in the middle: the gather samples compute its first reflection, photons bring the others.
#[test]
fn gather_lights_take_direct_light_themselves() {
    let camera = look(Vec3::ZERO, Vec3::new(0.3, 0.2, 1.0), 0.8);
    let frame = Frame::still(sphere(4), materials(&[(GREY, Vec3::ZERO)]), camera, [6, 4]);
    let lamp = lights(&[lamp(LightKind::Omni, Vec3::ZERO, Vec3::Y, GLOW)]);
    let direct = mean(&frame.reference(&lamp));
    // The facets lie a little inside the sphere: 0.2 %.
    let first = (GREY * GLOW).as_dvec3() / PI;
    near(direct, first, 5e-3, "direct");
    let photons = frame.photons(Some(&lamp), None, 32_768);
    let samples = frame.gather_samples(4096).unwrap().into();
    let gathered = frame.gather_lights(&samples, Some(&lamp), Some(photons), 10_000);
    let all = direct + mean(&frame.reference(&gathered.into()));
    near(all, first / (DVec3::ONE - GREY.as_dvec3()), 1e-2, "all orders");
}
