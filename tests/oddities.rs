//! Surfaces, times and environments that should not occur, through the nodes; lights and sizes are in `extremes`.

use super::extremes::{SIZE, black, count, finite, grey_plane, omni, shot};
use super::scenes::{
    Frame, Shot, block, lamp, lights, look, maps, materials, plane, quad, relative_l2, room, same,
    soups,
};
use glam::{Mat4, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{Array, Environment, LightKind, Lights, NONE, encode};
use nodes::kernel::element::Light;
use nodes::node::{All, Ctx, Error, Item, Node};

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
