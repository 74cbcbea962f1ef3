//! Numerical extremes of lights, clusters and sizes, through the nodes: what is expected of each input that should not occur.
//! Those of surfaces, time and environments are in `oddities`.

use super::scenes::{
    Frame, Shot, block, gathered, lamp, lights, look, materials, plane, relative_l2, room, same,
    scaled, soups, turning_room,
};
use glam::{Mat4, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{Array, Camera, Clusters, Image, LightKind, NONE};
use nodes::kernel::element::Light;
use nodes::kernel::history::cut;
use nodes::node::{Ctx, Error, Item, Many, Node};

pub const SIZE: [u32; 2] = [16, 12];

pub fn count(count: u32) -> nodes::Representatives {
    nodes::Representatives { count, ..Default::default() }
}

pub fn finite(image: &Image) -> bool {
    image.radiance.iter().all(|p| p.is_finite() && p.min_element() >= 0.0)
}

pub fn black(image: &Image) -> bool {
    image.radiance.iter().all(|p| *p == Vec3::ZERO)
}

pub fn omni(position: Vec3, emission: Vec3) -> Light {
    lamp(LightKind::Omni, position, Vec3::Y, emission)
}

/// A plane of grey seen from above.
pub fn grey_plane(size: [u32; 2]) -> Frame {
    let surfaces = materials(&[(Vec3::splat(0.5), Vec3::ZERO)]);
    Frame::still(plane(10.0), surfaces, look(Vec3::Y * 4.0, Vec3::ZERO, 0.5), size)
}

pub fn shot(frames: u32, many: u32, bins: [u32; 2]) -> Shot {
    let frames = turning_room(frames, SIZE);
    let lights = gathered(&frames, many);
    Shot::new(frames, lights, bins)
}

pub fn clusters(shot: &Shot, limit: u32) -> (Clusters, Vec<String>) {
    let ctx = Ctx::default();
    let node = nodes::Clusters { start: limit.min(10), limit, ..Default::default() };
    let input = nodes::ClustersIn { rows: shot.all_rows(), maps: None };
    (node.run(input, &ctx).unwrap(), ctx.notes())
}

/// N1: lights that reach nothing give no cluster and a black image.
#[test]
fn lights_that_reach_nothing_render_black() {
    // Below the plane, beside one of zero emission, under every method.
    let frame = grey_plane(SIZE);
    let below: Vec<Light> =
        (0..20).map(|i| omni(Vec3::new(0.1 * i as f32, -1.0, 0.0), Vec3::ONE)).collect();
    let off = omni(Vec3::Y, Vec3::ZERO);
    for all in [lights(&below), lights(&[off]), lights(&[below.clone(), vec![off]].concat())] {
        let shot = Shot::new(vec![frame.clone(); 2], vec![all.clone(); 2], [4, 3]);
        let (over_time, notes) = clusters(&shot, 10);
        assert!(over_time.start.is_empty() && over_time.split.is_empty());
        assert_eq!(notes, [format!("none of {} lights reaches a sampled pixel", all.kind.len())]);
        for clusters in [over_time, shot.column_clusters(10)] {
            let representatives = shot.representatives(&clusters.into(), &count(10));
            assert!(representatives.pair.is_empty());
            assert!(shot.reconstruct(representatives, &shot.maps()).iter().all(black));
        }
        assert!(black(&frame.reference(&all)));
    }
    // A few dark columns among others change nothing of the others.
    let lit = omni(Vec3::new(0.5, 1.0, 0.2), Vec3::ONE);
    let mixed = Shot::new(vec![frame.clone()], vec![lights(&[below, vec![lit]].concat())], [4, 3]);
    let image = mixed.render(10, 10);
    assert!(same(&image[0], &frame.reference(&lights(&[lit]))));
}

/// N2: a red light stands for a blue one at the same place.
#[test]
fn a_representative_dark_in_a_channel_stays_finite() {
    let place = Vec3::new(0.3, 1.0, 0.2);
    let pair = [omni(place, Vec3::X * 2.0), omni(place, Vec3::Z)];
    let shot = Shot::new(vec![grey_plane(SIZE)], vec![lights(&pair)], [4, 3]);
    let (clusters, _) = clusters(&shot, 1);
    let clusters: Item<_> = clusters.into();
    let scaled_by = |scale| {
        let representatives =
            shot.representatives(&clusters, &nodes::Representatives { scale, ..count(1) });
        assert_eq!(representatives.pair[..], [[0, 0]]);
        (representatives.weight[0], shot.reconstruct(representatives, &[]).remove(0))
    };
    // Channels in which the representative is dark take the ratio of the whole columns.
    let (weight, image) = scaled_by(nodes::Scale::Rgb);
    assert_eq!(weight, Vec3::new(1.0, 1.5, 1.5));
    assert!(finite(&image) && !black(&image));
    // The scalar ratio keeps the blue light's energy, in the only colour that the representative has.
    let (weight, image) = scaled_by(nodes::Scale::Scalar);
    assert_eq!(weight, Vec3::splat(1.5));
    let sum = |i: &Image| i.radiance.iter().map(|p| p.as_dvec3().element_sum()).sum::<f64>();
    let (found, expected) = (sum(&image), sum(&shot.reference()[0]));
    assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
}

/// N3: a sun on half of the plane beside lamps of a million millionth of its strength.
#[test]
fn a_sun_leaves_faint_lamps_as_they_are() {
    // A roof over the half at x > 0 keeps the sun off; lamps are below it and on the other side.
    let mut triangles = plane(10.0);
    triangles.extend(block(Vec3::new(0.0, 3.0, -5.0), Vec3::new(5.0, 0.5, 10.0)));
    let camera = look(Vec3::new(0.0, 2.5, 0.0), Vec3::ZERO, 0.8);
    let frame = Frame::still(triangles, materials(&[(Vec3::splat(0.5), Vec3::ZERO)]), camera, SIZE);
    let place = |i: usize| {
        let at = |p: f32| (i as f32 * p).fract();
        omni(
            Vec3::new(4.0 * at(0.618) - 2.0, 0.3 + at(0.33), 4.0 * at(0.755) - 2.0),
            Vec3::splat(1e-3 * (1.0 + at(0.9))),
        )
    };
    let faint: Vec<Light> = (0..150).map(place).collect();
    let sun = lamp(LightKind::Directional, Vec3::ZERO, Vec3::NEG_Y, Vec3::splat(1e9));
    let with = [faint.clone(), vec![sun]].concat();
    let night = Shot::new(vec![frame.clone()], vec![lights(&faint)], [8, 6]);
    let day = Shot::new(vec![frame.clone()], vec![lights(&with)], [8, 6]);
    let shade = |image: &Image| {
        let inside = |i: usize| frame.framebuffer.position[i].x > 0.2;
        let pixels = image
            .radiance
            .iter()
            .enumerate()
            .filter(|(i, _)| inside(*i))
            .map(|(_, p)| *p)
            .collect::<Vec<_>>();
        Image::new(pixels.len(), 1, pixels)
    };
    let truth = [shade(&night.reference()[0])];
    let rendered = |shot: &Shot, many| [shade(&shot.render(20, many)[0])];
    // Every light by itself: nothing of the lamps is lost in the sun.
    let (by_night, by_day) = (rendered(&night, 151), rendered(&day, 151));
    let change = relative_l2(&by_day, &by_night);
    assert!(change < 1e-4, "{change}");
    // In clusters: the first split leaves the sun alone in its own, and the lamps are as well approximated as without it.
    let (clusters, _) = clusters(&day, 40);
    for many in [11, 40] {
        let with_sun =
            cut(&clusters, many).unwrap().into_iter().find(|c| c.lights.contains(&150)).unwrap();
        assert_eq!(with_sun.lights, [150]);
    }
    let errors = [&night, &day].map(|shot| relative_l2(&rendered(shot, 40), &truth));
    assert!(errors[1] < 1.5 * errors[0], "{errors:?}");
}

/// N4 and N30: powers of two of the emission scale the image and change no bit else, also where
/// squares of sums are beyond f32.
#[test]
fn powers_of_two_of_the_emission_scale_the_image() {
    let shot = shot(2, 200, [4, 3]);
    let images = shot.render(10, 40);
    for exponent in [-40, 40, 80] {
        let factor = 2.0_f32.powi(exponent);
        let lights = shot.lights.iter().map(|l| scaled(l, factor)).collect();
        let other = Shot::new(shot.frames.clone(), lights, [4, 3]);
        for (image, found) in images.iter().zip(&other.render(10, 40)) {
            let expected = Image {
                radiance: Array::shaped(
                    image.radiance.iter().map(|p| *p * factor).collect(),
                    image.radiance.shape(),
                ),
            };
            assert!(same(&expected, found), "2^{exponent}");
        }
        assert!(relative_l2(&other.reference(), &other.render(10, 200)) < 0.1);
    }
}

/// The turning room at another size, with its lamp and photons: direct, gathered and all of it.
fn sized(scale: f32) -> (Vec<Image>, Vec<Image>) {
    let grow = |mut part: Vec<super::scenes::Triangle>| {
        part.iter_mut().flat_map(|t| &mut t.0).for_each(|p| *p *= scale);
        part
    };
    let parts = [grow(room()), grow(block(Vec3::new(-0.15, 0.0, -0.15), Vec3::new(0.3, 0.4, 0.3)))];
    let surfaces = [Vec3::splat(0.7), Vec3::new(0.7, 0.1, 0.1), Vec3::new(0.1, 0.7, 0.1)]
        .map(|a| (a, Vec3::ZERO));
    let (geometry, materials) = (soups(&parts).into(), materials(&surfaces).into());
    let (mut frames, mut all) = (Vec::new(), Vec::new());
    for k in 0..2 {
        let step = k as f32;
        let turn = Mat4::from_translation(Vec3::new(0.55, 0.0, 0.45) * scale)
            * Mat4::from_rotation_y(0.3 + 0.1 * step);
        let camera =
            look(Vec3::new(0.42, 0.6, 0.97) * scale, Vec3::new(0.5, 0.35, 0.3) * scale, 0.6);
        let camera = Camera { clip: [0.01 * scale, 100.0 * scale], ..camera };
        let frame = Frame::posed(&geometry, &materials, &[Mat4::IDENTITY, turn], camera, SIZE);
        let lamp = lights(&[omni(
            Vec3::new(0.2, 0.85, 0.4) * scale,
            Vec3::new(1.0, 0.9, 0.7) * scale * scale,
        )]);
        let samples = frame.gather_samples(200).unwrap().into();
        let photons = frame.photons(Some(&lamp), None, 4000);
        let gathered = frame.gather_lights(&samples, Some(&lamp), Some(photons), 50).into();
        let input = nodes::MergeLightsIn { lights: Many(vec![lamp, gathered]) };
        all.push(nodes::MergeLights { total: 1000 }.run(input, &Ctx::default()).unwrap().into());
        frames.push(frame);
    }
    let shot = Shot::new(frames, all, [4, 3]);
    (shot.reference(), shot.render(10, 40))
}

/// N5: a scene a million times as large or as small is the same picture.
#[test]
fn the_size_of_a_scene_does_not_count() {
    let (reference, image) = sized(1.0);
    for scale in [1e6, 1e-6] {
        let (other, rendered) = sized(scale);
        let off = [relative_l2(&other, &reference), relative_l2(&rendered, &image)];
        assert!(off[0] < 1e-4 && off[1] < 1e-4, "{scale:e}: {off:?}");
    }
}

/// N6: a thousand lights in one place are one cluster and never split for ever.
#[test]
fn equal_lights_are_one_column() {
    let same_place = vec![omni(Vec3::new(0.3, 1.0, 0.2), Vec3::splat(0.01)); 1000];
    let shot = Shot::new(vec![grey_plane(SIZE)], vec![lights(&same_place)], [4, 3]);
    let error = relative_l2(&shot.render(10, 10), &shot.reference());
    assert!(error < 1e-5, "{error}");
}

/// N8: one of everything.
#[test]
fn one_of_everything_is_the_reference() {
    let frame = grey_plane([1, 1]);
    let light = lights(&[omni(Vec3::new(0.3, 1.0, 0.2), Vec3::new(1.0, 2.0, 3.0))]);
    let shot = Shot::new(vec![frame], vec![light], [1, 1]);
    for clusters in [clusters(&shot, 1).0, shot.column_clusters(1)] {
        for choose in [nodes::Choose::Max, nodes::Choose::Random, nodes::Choose::Medoid] {
            let node = nodes::Representatives { choose, ..count(1) };
            let image =
                shot.reconstruct(shot.representatives(&clusters.clone().into(), &node), &[]);
            assert!(same(&image[0], &shot.reference()[0]) && !black(&image[0]));
        }
    }
}

/// N9: more clusters asked for than light-frame pairs that shine.
#[test]
fn more_clusters_than_lights_are_as_many_as_there_are() {
    let all: Vec<Light> = (0..10)
        .map(|i| omni(Vec3::new(0.3 * i as f32, 1.0, 0.0), Vec3::splat((i % 2) as f32)))
        .collect();
    let shot = Shot::new(vec![grey_plane(SIZE); 2], vec![lights(&all); 2], [4, 3]);
    let (over_time, _) = clusters(&shot, 500);
    for clusters in [Item::from(over_time), shot.column_clusters(500).into()] {
        let ctx = Ctx::default();
        let input = nodes::RepresentativesIn { clusters, rows: shot.all_rows() };
        let representatives = count(500).run(input, &ctx).unwrap();
        assert_eq!(representatives.pair.len(), 10, "five lights in two frames");
        let [note] = &ctx.notes()[..] else { panic!("{:?}", ctx.notes()) };
        assert!(note.starts_with("10 clusters exist where 1000 were asked for"), "{note}");
        assert!(relative_l2(&shot.reconstruct(representatives, &[]), &shot.reference()) < 1e-6);
    }
}

/// N10: a camera that sees nothing is told, and the background is still a picture.
#[test]
fn a_camera_that_sees_nothing_is_told() {
    let surfaces = materials(&[(Vec3::splat(0.5), Vec3::ZERO)]);
    let away = look(Vec3::Y * 4.0, Vec3::Y * 9.0, 0.5);
    let frame = Frame::still(plane(10.0), surfaces, away, SIZE);
    let light = lights(&[omni(Vec3::Y, Vec3::ONE)]);
    let Err(Error::Invalid(text)) = frame.rows(&light, [4, 3]) else {
        panic!("an error was expected")
    };
    assert!(text.contains("no shading samples"), "{text}");
    assert!(black(&frame.reference(&light)));
    assert!(frame.framebuffer.triangle.iter().all(|t| *t == NONE));
    // Half of the bins on the background are dark rows, and nothing else.
    let half = look(Vec3::new(0.0, 1.0, 4.9), Vec3::new(0.0, 1.0, 0.0), 0.9);
    let frame = Frame::still(plane(10.0), materials(&[(Vec3::splat(0.5), Vec3::ZERO)]), half, SIZE);
    let shot = Shot::new(vec![frame], vec![light], [4, 4]);
    assert!(shot.rows[0].pixel[..4].iter().all(|p| *p == NONE) && shot.rows[0].pixel[12] != NONE);
    assert!(same(&shot.render(1, 1)[0], &shot.reference()[0]));
}
