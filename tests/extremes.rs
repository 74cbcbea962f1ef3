//! Numerical extremes through the nodes: what is expected of each input that should not occur.

use super::scenes::{
    Frame, Shot, block, gathered, lamp, lights, look, maps, materials, plane, quad, relative_l2,
    room, same, scaled, soups, turning_room,
};
use glam::{Mat4, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{Array, Camera, Clusters, Environment, Image, LightKind, Lights, NONE, encode};
use nodes::kernel::element::Light;
use nodes::kernel::history::cut;
use nodes::node::{All, Ctx, Error, Item, Many, Node};

const SIZE: [u32; 2] = [16, 12];

fn count(count: u32) -> nodes::Representatives {
    nodes::Representatives { count, ..Default::default() }
}

fn finite(image: &Image) -> bool {
    image.radiance.iter().all(|p| p.is_finite() && p.min_element() >= 0.0)
}

fn black(image: &Image) -> bool {
    image.radiance.iter().all(|p| *p == Vec3::ZERO)
}

fn omni(position: Vec3, emission: Vec3) -> Light {
    lamp(LightKind::Omni, position, Vec3::Y, emission)
}

/// A plane of grey seen from above.
fn grey_plane(size: [u32; 2]) -> Frame {
    let surfaces = materials(&[(Vec3::splat(0.5), Vec3::ZERO)]);
    Frame::still(plane(10.0), surfaces, look(Vec3::Y * 4.0, Vec3::ZERO, 0.5), size)
}

fn shot(frames: u32, many: u32, bins: [u32; 2]) -> Shot {
    let frames = turning_room(frames, SIZE);
    let lights = gathered(&frames, many);
    Shot::new(frames, lights, bins)
}

fn clusters(shot: &Shot, limit: u32) -> (Clusters, Vec<String>) {
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
        assert_eq!(ctx.notes(), ["10 clusters exist where 1000 were asked for"]);
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

/// N11: triangles without area, not finite, and doubled vertices are never hit and hold no samples.
#[test]
fn broken_triangles_leave_the_picture_finite() {
    let mut triangles = room();
    let sound = triangles.len();
    let point = Vec3::splat(0.5);
    triangles.push(([point; 3], 1));
    triangles.push(([Vec3::new(0.2, 0.2, 0.2), point, Vec3::splat(0.8)], 1));
    triangles.push(([Vec3::NAN, Vec3::X, Vec3::Y], 1));
    triangles.push(([Vec3::ZERO, Vec3::X * f32::INFINITY, Vec3::Y], 1));
    triangles.push(([Vec3::ZERO, Vec3::ZERO, Vec3::Y], 1));
    // The floor once more: coplanar doubles.
    triangles.extend(quad(Vec3::ZERO, Vec3::Z, Vec3::X, 0));
    let albedo = Vec3::splat(0.6);
    let surfaces = materials(&[(albedo, Vec3::ZERO), (albedo, Vec3::ONE), (albedo, Vec3::ZERO)]);
    let mut geometry = soups(&[triangles]);
    // Normals that are no normals.
    let mut normal = geometry.normal.to_vec();
    normal[0] = Vec3::NAN;
    normal[3] = Vec3::splat(f32::INFINITY);
    geometry.normal = normal.into();
    let camera = look(Vec3::new(0.5, 0.6, 0.9), Vec3::new(0.4, 0.3, 0.2), 0.8);
    let frame = Frame::new(geometry, surfaces, &[Mat4::IDENTITY], camera, [32, 24]);
    let broken = |t: u32| (sound..sound + 5).contains(&(t as usize));
    assert!(!frame.framebuffer.triangle.iter().any(|t| *t == NONE || broken(*t)));
    let unit = |n: &Vec3| (n.length() - 1.0).abs() < 1e-5;
    assert!(frame.framebuffer.normal.iter().all(unit) && frame.framebuffer.facet.iter().all(unit));
    let samples = frame.gather_samples(500).unwrap();
    assert!(
        !samples.triangle.iter().any(|t| broken(*t)) && samples.share.iter().all(|s| s.is_finite())
    );
    let emissive: Item<Lights> = frame.emissive(200).into();
    assert!(
        emissive.position.iter().all(|p| p.is_finite())
            && emissive.emission.iter().all(|e| e.is_finite())
    );
    let photons = frame.photons(None, Some(&emissive), 2000);
    let gathered = frame.gather_lights(&samples.into(), Some(&emissive), Some(photons), 50).into();
    let shot = Shot::new(vec![frame.clone(); 2], vec![gathered; 2], [4, 3]);
    assert!(shot.render(10, 40).iter().chain(&shot.reference()).all(|i| finite(i) && !black(i)));
    assert!(finite(&frame.reference(&emissive)));
}

/// N12: lights on what they light, behind it and grazing.
#[test]
fn lights_on_a_receiver_are_bounded() {
    let frame = grey_plane([1, 1]);
    let at = frame.framebuffer.position[0];
    let radiance = |light: Light| frame.reference(&lights(&[light])).radiance[0];
    for kind in [LightKind::Omni, LightKind::Spot, LightKind::Cosine] {
        // Exactly on the sample, behind it, and in its plane.
        for offset in [Vec3::ZERO, Vec3::NEG_Y, Vec3::X, Vec3::NEG_Y * 1e-6] {
            let light = Light { clamp: 0.1, ..lamp(kind, at + offset, Vec3::NEG_Y, Vec3::ONE) };
            assert_eq!(radiance(light), Vec3::ZERO, "{kind:?} at {offset}");
        }
        // From far to near: it grows up to the clamp and stays below what the clamp allows.
        let mut before = 0.0;
        for distance in [3.0, 1.0, 0.3, 0.1] {
            let light =
                Light { clamp: 0.1, ..lamp(kind, at + Vec3::Y * distance, Vec3::NEG_Y, Vec3::ONE) };
            let found = radiance(light).x;
            assert!(
                found > before && found <= 0.5 / std::f32::consts::PI / 0.01 * 1.001,
                "{kind:?} {distance}: {found}"
            );
            before = found;
        }
        for distance in [1e-3_f32, 1e-6, 1e-12, 1e-20, f32::MIN_POSITIVE] {
            for clamp in [0.0, 0.1] {
                let light = Light {
                    clamp,
                    ..lamp(kind, at + Vec3::Y * distance, Vec3::NEG_Y, Vec3::splat(1e20))
                };
                assert!(radiance(light).is_finite(), "{kind:?} {distance:e} {clamp}");
            }
        }
    }
}

/// N21: maps of frames that see nothing, of a cut, and of what did not move.
#[test]
fn maps_of_background_are_unmapped() {
    let surfaces = || materials(&[(Vec3::splat(0.5), Vec3::ZERO)]);
    let seeing =
        |at: Vec3, size| Frame::still(plane(10.0), surfaces(), look(Vec3::Y * 4.0, at, 0.5), size);
    let (full, empty) = (seeing(Vec3::ZERO, SIZE), seeing(Vec3::Y * 9.0, SIZE));
    let none = |m: &Array<u32>| m.iter().all(|p| *p == NONE);
    let both = maps(&empty, &empty);
    assert!(none(&both.forward) && none(&both.backward) && both.far == 0.0);
    for (this, next) in [(&full, &empty), (&empty, &full)] {
        let cut = maps(this, next);
        assert!(none(&cut.forward) && none(&cut.backward));
        assert_eq!(cut.far, 1.0);
    }
    // A thing that jumps does not cut the shot: most pixels keep their place.
    let jumped = |x: f32| {
        let parts = [room(), block(Vec3::ZERO, Vec3::splat(0.1))];
        let camera = look(Vec3::new(0.5, 0.6, 0.95), Vec3::new(0.5, 0.3, 0.3), 0.6);
        let surfaces = materials(&[(Vec3::splat(0.7), Vec3::ZERO); 3]);
        Frame::new(
            soups(&parts),
            surfaces,
            &[Mat4::IDENTITY, Mat4::from_translation(Vec3::new(x, 0.0, 0.4))],
            camera,
            SIZE,
        )
    };
    let jump = maps(&jumped(0.2), &jumped(0.7));
    assert!(jump.far < 0.1 && !jump.forward.contains(&NONE), "{}", jump.far);
    // A shot that starts on the background goes through the pipeline: its first frame has dark rows only.
    let light = lights(&[omni(Vec3::Y, Vec3::ONE)]);
    assert!(empty.rows(&light, [4, 3]).is_err());
}

/// N23: a chunk of one frame is a still, with or without a list of no maps.
#[test]
fn a_chunk_of_one_frame_is_a_still() {
    let long = shot(3, 200, [4, 3]);
    for k in 0..3 {
        let one = Shot {
            frames: vec![long.frames[k].clone()],
            lights: vec![long.lights[k].clone()],
            rows: vec![long.rows[k].clone()],
        };
        let over_time: Item<_> = one.clusters(10, 40, &[]).into();
        assert_eq!((over_time.frames, over_time.lights), (1, 200));
        let representatives = one.representatives(&over_time, &count(40));
        assert!(representatives.frames.iter().all(|f| *f == [0, 1]));
        let still = one.reconstruct(representatives.clone(), &[]);
        let empty = nodes::ReconstructIn {
            maps: Some(Vec::new().into()),
            ..one.to_reconstruct(representatives, &[])
        };
        let sequence = nodes::Reconstruct {}.run(empty, &Ctx::default()).unwrap();
        assert_eq!((sequence.items.len(), sequence.chunk), (1, 1));
        assert!(same(&still[0], &sequence.items[0]));
        // Every light by itself, it lacks only what the rows missed.
        let all = one.clusters(10, 200, &[]).into();
        let all = one.reconstruct(one.representatives(&all, &count(200)), &[]);
        assert!(relative_l2(&all, &one.reference()) < 0.05);
    }
}

/// N24: photons that meet nothing, none at all, and more asked for than there are.
#[test]
fn without_photons_gather_lights_are_dark() {
    let frame = grey_plane(SIZE);
    let samples: Item<_> = frame.gather_samples(50).unwrap().into();
    let below = lights(&[omni(Vec3::new(0.0, 1e6, 0.0), Vec3::ZERO)]);
    let upwards = lights(&[lamp(LightKind::Directional, Vec3::ZERO, Vec3::X, Vec3::ONE)]);
    let cone = Light {
        cone: glam::Vec2::new(0.99, 0.98),
        ..lamp(LightKind::Spot, Vec3::Y, Vec3::Y, Vec3::ONE)
    };
    for nothing in [below, upwards, lights(&[cone])] {
        for photons in
            [frame.photons(None, None, 100), frame.photons(Some(&nothing), Some(&nothing), 100)]
        {
            assert!(photons.power.is_empty());
            let gathered = frame.gather_lights(&samples, None, Some(photons), 50);
            assert!(gathered.emission.iter().all(|e| *e == Vec3::ZERO));
        }
    }
    // One photon, and a thousand on one spot.
    let once = lamp(LightKind::Cosine, Vec3::Y, Vec3::NEG_Y, Vec3::ONE);
    let down = Light {
        cone: glam::Vec2::new(1.0, 0.999_999_9),
        ..lamp(LightKind::Spot, Vec3::Y, Vec3::NEG_Y, Vec3::ONE)
    };
    for (light, many) in [(once, 1), (down, 1000)] {
        let photons = frame.photons(None, Some(&lights(&[light])), many);
        assert!(!photons.power.is_empty());
        let gathered = frame.gather_lights(&samples, None, Some(photons), 10_000);
        assert!(gathered.emission.iter().all(|e| e.is_finite() && e.min_element() >= 0.0));
    }
}

/// N25: environments of one texel, without light, and with a texel that outshines all others.
#[test]
fn any_environment_makes_lights() {
    let run = |width: usize, height: usize, radiance: Vec<Vec3>, count: u32| {
        let environment =
            Environment { radiance: Array::shaped(radiance, &[height, width]) }.into();
        nodes::EnvironmentLights { count, seed: 1 }
            .run(nodes::EnvironmentLightsIn { environment }, &Ctx::default())
            .unwrap()
    };
    let sound = |l: &Lights| {
        l.emission.iter().all(|e| e.is_finite())
            && l.direction.iter().all(|d| (d.length() - 1.0).abs() < 1e-5)
    };
    let power = |l: &Lights| l.emission.iter().map(|e| f64::from(e.x)).sum::<f64>();
    for many in [1, 2, 3, 7, 1000] {
        let one = run(1, 1, vec![Vec3::ONE], many);
        assert!(sound(&one) && one.kind.len() == many as usize);
        assert!((power(&one) / (4.0 * std::f64::consts::PI) - 1.0).abs() < 1e-5, "{many}");
        let dark: Item<Lights> = run(4, 2, vec![Vec3::ZERO; 8], many).into();
        assert!(sound(&dark) && dark.emission.iter().all(|e| *e == Vec3::ZERO));
        assert!(black(&grey_plane(SIZE).reference(&dark)));
    }
    let mut spiky = vec![Vec3::splat(1e-6); 64 * 32];
    spiky[5 * 64 + 40] = Vec3::splat(1e30);
    assert!(sound(&run(64, 32, spiky, 500)));
}

/// N27: the whole pipeline has the same bits on one, two and three threads.
#[test]
fn threads_do_not_count() {
    let render =
        || shot(2, 200, [4, 3]).render(10, 40).iter().flat_map(encode).collect::<Vec<u8>>();
    let on = |threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(render)
    };
    let one = on(1);
    assert!(one == on(2) && one == on(3));
}

/// No light, and lists that do not belong together: errors that say so, never a panic.
#[test]
fn what_does_not_fit_is_told() {
    let text = |error: Error| error.to_string();
    let frame = grey_plane(SIZE);
    assert!(text(frame.rows(&lights(&[]), [4, 3]).unwrap_err()).contains("no light"));
    assert!(black(&frame.reference(&lights(&[]))));
    let light = |n: usize| lights(&vec![omni(Vec3::Y, Vec3::ONE); n]);
    let shot = Shot::new(vec![frame.clone(); 2], vec![light(2), light(3)], [4, 3]);
    let clusters = nodes::Clusters { start: 1, limit: 10, ..Default::default() };
    let input = nodes::ClustersIn { rows: shot.all_rows(), maps: None };
    assert!(
        text(clusters.run(input, &Ctx::default()).unwrap_err())
            .contains("same light in every frame")
    );
    let mut drawn = (*frame.rows(&light(2), [4, 3]).map(Item::from).unwrap()).clone();
    drawn.identity = 0;
    let rows: All<_> = vec![Item::from(drawn); 2].into();
    let input = nodes::ClustersIn { rows, maps: None };
    assert!(text(clusters.run(input, &Ctx::default()).unwrap_err()).contains("PhotonLights"));
    let nothing: All<nodes::data::Rows> = Vec::new().into();
    assert!(
        clusters.run(nodes::ClustersIn { rows: nothing, maps: None }, &Ctx::default()).is_err()
    );
    let empty = Frame::still(Vec::new(), materials(&[]), look(Vec3::Y, Vec3::ZERO, 0.5), SIZE);
    assert!(text(empty.gather_samples(10).unwrap_err()).contains("no surface"));
    assert!(empty.framebuffer.triangle.iter().all(|t| *t == NONE));
}
