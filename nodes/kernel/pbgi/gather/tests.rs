//! The whole gather against what is known.

use super::fixtures::*;
use super::*;
use crate::kernel::brdf::Reflectance;
use crate::kernel::pbgi::hierarchy::{Bound, Entry, Sent, Surfel};
use std::f32::consts::PI;

/// Both shapes at about the same number of cells: 192 and 196.
fn buffers() -> [MicroBuffer; 2] {
    [MicroBuffer::new(Shape::Cube, 8), MicroBuffer::new(Shape::Lambert, 14)]
}

fn exact(surfels: Vec<Surfel>) -> Tree {
    Tree::of(surfels, Answers::Exact)
}

/// Irradiance at the origin of a floor.
fn floor(surfels: Vec<Surfel>, buffer: &MicroBuffer) -> Vec3 {
    gather(&exact(surfels), &white(Vec3::ZERO, Vec3::Y), buffer).radiance * PI
}

/// A ceiling that looks down from `height`, `half` wide to each side.
fn ceiling(height: f32, half: f32, radiance: Vec3) -> Vec<Surfel> {
    sheet(Vec3::Y * height, [Vec3::X * half, Vec3::Z * half], 40, radiance, 0.3)
}

#[test]
fn a_closed_furnace_is_full() {
    for buffer in buffers() {
        for (answers, full, loss) in [
            (Answers::Exact, 1.0, 0.025),
            (Answers::Exact, 0.9, 0.003),
            (Answers::Harmonics, 0.9, 0.005),
        ] {
            let settings = Settings { full, ..Settings::default() };
            let check = |surfels: Vec<Surfel>, receivers: &[Receiver]| {
                let tree = Tree::of(surfels, answers);
                let background = |_| Vec3::ZERO;
                let gather = Gather { hierarchy: &tree, buffer: &buffer, settings, background };
                for receiver in receivers {
                    let found = gather.one(receiver, &mut Scratch::default(), &mut Work::default());
                    let red = found.radiance.x;
                    assert!(
                        (1.0 - loss..1.0001).contains(&red),
                        "{full}: {red} at {}",
                        receiver.position
                    );
                    assert!(found.open < loss + 1e-5, "{full}: {}", found.open);
                }
            };
            let inside = |i: u32| {
                let turn = Vec3::new(noise(i) - 0.5, noise(i + 9) - 0.5, noise(i + 99) - 0.5);
                white(Vec3::new(turn.y, turn.z, turn.x) * 1.2, turn.normalize())
            };
            let floor = |i| white(Vec3::new(0.11 * i as f32, -1.0, 0.03 * i as f32), Vec3::Y);
            let ball = sphere(Vec3::ZERO, 1.0, 3000, Vec3::ONE, -1.0);
            check(ball, &(0..8).map(inside).collect::<Vec<_>>());
            let walls = room(40, Vec3::ONE, 0.5);
            check(walls, &(0..10).map(floor).collect::<Vec<_>>());
        }
    }
}

#[test]
fn a_large_near_disc_has_its_form_factor() {
    for buffer in buffers() {
        for radius in [1.0_f32, 2.0, 10.0] {
            let disc = disc(Vec3::Y, Vec3::NEG_Y, radius, Vec3::ONE);
            let expected = PI * radius * radius / (1.0 + radius * radius);
            let found = floor(vec![disc], &buffer).x;
            assert!((found / expected - 1.0).abs() < 0.05, "{radius}: {found} {expected}");
        }
    }
}

#[test]
fn a_far_surfel_sends_exactly_its_share() {
    for buffer in buffers() {
        for i in 0..200 {
            let (height, turn) = (0.02 + 0.98 * noise(i), i as f32 * 0.37);
            let wide = (1.0 - height * height).sqrt();
            let to = Vec3::new(wide * turn.cos(), height, wide * turn.sin());
            let normal =
                (Vec3::new(noise(i + 500) - 0.5, 0.3, noise(i + 900) - 0.5) - to).normalize();
            let found = floor(vec![disc(to * 50.0, normal, 1.0, Vec3::ONE)], &buffer).x;
            let expected = PI / 2500.0 * height * -normal.dot(to);
            assert!((found / expected - 1.0).abs() < 1e-4, "{to} {normal}: {found} {expected}");
        }
    }
}

#[test]
fn an_opaque_sheet_hides_what_is_behind() {
    for buffer in buffers() {
        let lamp = vec![disc(Vec3::Y * 10.0, Vec3::NEG_Y, 1.0, Vec3::new(0.0, 9.0, 0.0))];
        assert!(floor(lamp.clone(), &buffer).y > 0.25);
        let below = [lamp.clone(), ceiling(3.0, 4.0, Vec3::X)].concat();
        let found = floor(below, &buffer);
        assert!(found.y < 1e-3 && found.x > 1.0, "{found}");
        let above = [lamp, ceiling(13.0, 4.0, Vec3::X)].concat();
        assert!(floor(above, &buffer).y > 0.25);
    }
}

#[test]
fn of_two_sheets_the_nearer_is_seen() {
    for buffer in buffers() {
        let near = ceiling(1.0, 3.0, Vec3::X);
        let alone = floor(near.clone(), &buffer).x;
        let found = floor([near, ceiling(1.5, 3.0, Vec3::Y)].concat(), &buffer);
        assert!((found.x / alone - 1.0).abs() < 0.02, "{found} {alone}");
        // The farther one shows only where cells are cut by the edge of the nearer.
        assert!(found.y < 0.1 * alone, "{found} {alone}");
    }
}

#[test]
fn backs_are_not_seen_and_hide_nothing() {
    for buffer in buffers() {
        let turned: Vec<Surfel> = ceiling(1.0, 3.0, Vec3::X)
            .into_iter()
            .map(|s| Surfel { normal: -s.normal, ..s })
            .collect();
        let lit = ceiling(1.5, 1.0, Vec3::Y);
        let (found, alone) = (floor([turned, lit.clone()].concat(), &buffer), floor(lit, &buffer));
        // Another tree groups the same fronts: only its cut differs.
        assert!(found.x == 0.0 && (found.y / alone.y - 1.0).abs() < 0.03, "{found} {alone}");
        let near = disc(Vec3::Y, Vec3::Y, 3.0, Vec3::X);
        let behind = disc(Vec3::Y * 2.0, Vec3::NEG_Y, 1.0, Vec3::Y);
        assert_eq!(floor(vec![near, behind], &buffer), floor(vec![behind], &buffer));
    }
}

#[test]
fn what_is_below_or_on_the_plane_does_nothing() {
    for buffer in buffers() {
        for answers in [Answers::Exact, Answers::Harmonics] {
            let plane = sheet(Vec3::ZERO, [Vec3::Z * 5.0, Vec3::X * 5.0], 60, Vec3::ONE, 0.5);
            let below = sphere(Vec3::Y * -2.0, 1.5, 500, Vec3::ONE, 1.0);
            let tree = Tree::of([plane, below].concat(), answers);
            for i in 0..20 {
                let at = Vec3::new(noise(i) * 4.0 - 2.0, 0.0, noise(i + 77) * 4.0 - 2.0);
                let found = gather(&tree, &white(at, Vec3::Y), &buffer);
                assert_eq!((found.radiance, found.open), (Vec3::ZERO, 1.0));
                assert!(found.unoccluded.abs_diff_eq(Vec3::Y, 1e-2), "{}", found.unoccluded);
            }
        }
    }
}

#[test]
fn a_convex_surface_does_not_shadow_itself() {
    for buffer in buffers() {
        for count in [200, 2000] {
            let tree = exact(sphere(Vec3::ZERO, 1.0, count, Vec3::ONE, 1.0));
            for i in 0..30 {
                let out = Vec3::new(noise(i) - 0.5, noise(i + 77) - 0.5, noise(i + 55) - 0.5);
                let found = gather(&tree, &white(out.normalize(), out.normalize()), &buffer);
                assert!(found.open > 0.99 && found.radiance.x < 1e-3, "{count} {found:?}");
            }
        }
    }
}

#[test]
fn the_side_of_a_groove_does_not_stand_out_of_it() {
    // Discs as large as the groove is deep, on its far side: their upper halves are above the floor.
    let side = |k: i32| disc(Vec3::new(0.1, -0.3, 0.25 * k as f32), Vec3::NEG_X, 0.5, Vec3::ONE);
    let tree = exact((-4..=4).map(side).collect());
    for buffer in buffers() {
        let above = gather(&tree, &white(Vec3::ZERO, Vec3::Y), &buffer);
        assert_eq!((above.radiance, above.open), (Vec3::ZERO, 1.0));
        let below = gather(&tree, &white(Vec3::Y * -0.4, Vec3::Y), &buffer);
        assert!((0.3..0.6).contains(&below.open), "{below:?}");
    }
}

#[test]
fn a_wall_takes_half_of_the_sky() {
    for buffer in buffers() {
        let wall = sheet(Vec3::X, [Vec3::Z * 100.0, Vec3::Y * 100.0], 300, Vec3::ZERO, 0.2);
        let found = gather(&exact(wall), &white(Vec3::X * 0.95, Vec3::Y), &buffer);
        assert!((found.open - 0.5).abs() < 0.04, "{found:?}");
        let away = Vec3::new(-4.0, 2.0 * PI, 0.0).normalize();
        assert!(found.unoccluded.dot(away) > 0.9, "{found:?}");
    }
}

#[test]
fn the_background_fills_what_is_open() {
    for buffer in buffers() {
        let (tree, settings) = (exact(Vec::new()), Settings::default());
        let background = |d: Vec3| Vec3::splat(d.x.max(0.0));
        let gather = Gather { hierarchy: &tree, buffer: &buffer, settings, background };
        let receiver = white(Vec3::ZERO, Vec3::X);
        let found = gather.one(&receiver, &mut Scratch::default(), &mut Work::default());
        assert!((found.radiance.x - 2.0 / 3.0).abs() < 0.01, "{found:?}");
    }
}

#[test]
fn nothing_one_and_coincident_surfels() {
    for buffer in buffers() {
        let none = gather(&exact(Vec::new()), &white(Vec3::ZERO, Vec3::Y), &buffer);
        assert_eq!((none.radiance, none.open), (Vec3::ZERO, 1.0));
        let one = disc(Vec3::Y * 20.0, Vec3::NEG_Y, 1.0, Vec3::ONE);
        let alone = floor(vec![one], &buffer).x;
        assert!((alone / (PI / 400.0) - 1.0).abs() < 1e-4);
        // Two on one spot fill no more than their cell; here they are far from that.
        assert!((floor(vec![one; 2], &buffer).x / alone - 2.0).abs() < 1e-4);
        let on_it = disc(Vec3::ZERO, Vec3::Y, 1.0, Vec3::ONE);
        assert_eq!(floor(vec![on_it; 3], &buffer), Vec3::ZERO);
        let nowhere = disc(Vec3::NAN, Vec3::Y, 1.0, Vec3::ONE);
        assert_eq!(floor(vec![nowhere; 3], &buffer), Vec3::ZERO);
    }
}

#[test]
fn what_arrives_is_never_more_than_what_is_sent() {
    for buffer in buffers() {
        for count in [1, 10, 100, 1000] {
            let surfels = soup(count, 0.1);
            let sent: f32 = surfels
                .iter()
                .map(|s| {
                    let (d, to) = (s.position.length(), s.position.normalize());
                    s.radiance.x * s.area * (-s.normal.dot(to)).max(0.0) * to.y.max(0.0) / (d * d)
                })
                .sum();
            let found = floor(surfels, &buffer).x;
            assert!(found <= sent * 1.01 && found <= PI, "{count}: {found} {sent}");
            assert!(found >= 0.5 * sent.min(PI), "{count}: {found} {sent}");
        }
    }
}

#[test]
fn finer_cells_come_closer_to_casting_discs() {
    let tree = exact(soup(400, 0.25));
    let receivers: Vec<Receiver> =
        (0..4).map(|i| white(Vec3::new(0.3 * i as f32, 0.0, 0.2), Vec3::Y)).collect();
    for shape in [Shape::Cube, Shape::Lambert] {
        let error = |resolution: u32| -> f32 {
            let buffer = MicroBuffer::new(shape, resolution);
            let errors = receivers.iter().map(|receiver| {
                let cast = cast(&tree.surfels, receiver, 128);
                (gather(&tree, receiver, &buffer).radiance - cast).length() / cast.length()
            });
            errors.sum::<f32>() / receivers.len() as f32
        };
        let [coarse, middle, fine] = [8, 16, 48].map(error);
        assert!(coarse < 0.15 && middle < coarse, "{shape:?} {coarse} {middle} {fine}");
        assert!(fine < 0.025 && fine < 0.25 * coarse, "{shape:?} {coarse} {middle} {fine}");
    }
}

#[test]
fn size_and_place_of_the_scene_do_not_matter() {
    let surfels = |scale: f32, shift: Vec3| {
        let mut surfels = room(12, Vec3::ONE, 0.4);
        surfels.extend(sphere(Vec3::new(0.2, -0.3, 0.1), 0.4, 200, Vec3::X, 1.0));
        for s in &mut surfels {
            s.position = s.position * scale + shift;
            s.radius *= scale;
            s.area *= scale * scale;
        }
        surfels
    };
    let at = |scale: f32, shift: Vec3, buffer: &MicroBuffer| {
        let tree = Tree::of(surfels(scale, shift), Answers::Harmonics);
        let place = Vec3::new(0.55, -1.0, 0.3) * scale + shift;
        gather(&tree, &white(place, Vec3::Y), buffer).radiance
    };
    for buffer in buffers() {
        let here = at(1.0, Vec3::ZERO, &buffer);
        for power in [-20, -7, 9, 20] {
            assert_eq!(at(2.0_f32.powi(power), Vec3::ZERO, &buffer), here);
        }
        for scale in [1e-6, 1e6] {
            assert!(at(scale, Vec3::ZERO, &buffer).abs_diff_eq(here, 2e-3), "{scale}");
        }
        for far in [1e2, 1e3, 1e4] {
            let there = at(1.0, Vec3::new(far, -far, 0.5 * far), &buffer);
            assert!(there.abs_diff_eq(here, 0.01), "{far}: {there} {here}");
        }
    }
}

#[test]
fn gloss_follows_the_brdf() {
    let lamp = Vec3::new(3.0, 4.0, 0.0);
    let tree = exact(vec![disc(lamp * 10.0, -lamp.normalize(), 2.0, Vec3::ONE)]);
    let reflectance =
        Reflectance { albedo: Vec3::splat(0.2), specular: Vec3::splat(0.5), roughness: 0.6 };
    for (shape, resolution) in [(Shape::Cube, 16), (Shape::Lambert, 28)] {
        let buffer = MicroBuffer::new(shape, resolution);
        for eye in [Vec3::new(-3.0, 4.0, 0.0), Vec3::Y, Vec3::new(0.0, 1.0, 2.0)] {
            let to_eye = eye.normalize();
            let receiver = Receiver { to_eye, reflectance, ..white(Vec3::ZERO, Vec3::Y) };
            let irradiance = PI * 4.0 / 2500.0 * 0.8;
            let expected = reflectance.brdf(Vec3::Y, to_eye, lamp.normalize()).x * irradiance;
            let found = gather(&tree, &receiver, &buffer).radiance.x;
            assert!((found / expected - 1.0).abs() < 0.05, "{shape:?} {eye}: {found} {expected}");
        }
    }
}

#[test]
fn a_lobe_narrower_than_a_cell_has_its_energy() {
    let (tree, finest) = (exact(Vec::new()), MicroBuffer::new(Shape::Cube, 64));
    for roughness in [0.3, 0.4, 0.45] {
        let reflectance = Reflectance { specular: Vec3::ONE, roughness, ..Reflectance::default() };
        for eye in [0.0, 0.3, 0.7, 1.1].map(|turn: f32| Vec3::new(turn.sin(), turn.cos(), 0.1)) {
            let to_eye = eye.normalize();
            let receiver = Receiver { to_eye, reflectance, ..white(Vec3::ZERO, Vec3::Y) };
            let under_white_sky = |buffer: &MicroBuffer| {
                let (settings, background) = (Settings::default(), |_| Vec3::ONE);
                let gather = Gather { hierarchy: &tree, buffer, settings, background };
                gather.one(&receiver, &mut Scratch::default(), &mut Work::default()).radiance.x
            };
            let fine = under_white_sky(&finest);
            for buffer in buffers() {
                let found = under_white_sky(&buffer);
                assert!((found / fine - 1.0).abs() < 0.03, "{roughness} {eye}: {found} {fine}");
            }
        }
    }
}

#[test]
fn nothing_comes_from_below_the_facet() {
    for buffer in buffers() {
        let facet = Vec3::new(0.6, 0.8, 0.0);
        let receiver = Receiver { facet, ..white(Vec3::ZERO, Vec3::Y) };
        let tree = exact(vec![disc(Vec3::new(-40.0, 20.0, 0.0), Vec3::X, 1.0, Vec3::ONE)]);
        let found = gather(&tree, &receiver, &buffer);
        assert_eq!((found.radiance, found.open), (Vec3::ZERO, 1.0));
        assert!(found.unoccluded.x > 0.1, "{found:?}");
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let tree = Tree::of(room(30, Vec3::new(0.3, 1.0, 0.2), 0.5), Answers::Harmonics);
    let receivers: Vec<Receiver> = (0..300)
        .map(|i| white(Vec3::new(noise(i) * 2.0 - 1.0, -1.0, noise(i + 999) - 0.5), Vec3::Y))
        .collect();
    let buffer = MicroBuffer::new(Shape::Lambert, 10);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let gather = Gather {
            hierarchy: &tree,
            buffer: &buffer,
            settings: Settings::default(),
            background: |_| Vec3::ZERO,
        };
        pool.install(|| gather.all(&receivers, |_, _| Ok::<_, ()>(())).unwrap())
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
    assert!(one.1.visited > one.1.splatted && one.1.cast > 0 && one.1.fragments > one.1.splatted);
}

#[test]
fn a_tick_can_stop_it() {
    let (tree, buffer) = (exact(Vec::new()), MicroBuffer::new(Shape::Cube, 2));
    let settings = Settings::default();
    let gather = Gather { hierarchy: &tree, buffer: &buffer, settings, background: |_| Vec3::ZERO };
    let receivers = vec![white(Vec3::ZERO, Vec3::Y); 1000];
    let result = gather.all(&receivers, |done, all| {
        assert_eq!(all, 16);
        if done < 3 { Ok(()) } else { Err("stopped") }
    });
    assert_eq!(result.unwrap_err(), "stopped");
}

/// Each inner node has one leaf and the rest of the chain.
struct Chain(u32);

impl Hierarchy for Chain {
    type Node = u32;

    fn root(&self) -> Option<u32> {
        Some(1)
    }

    fn entry(&self, node: u32) -> Entry {
        match node.is_multiple_of(2) || node >= 2 * self.0 {
            true => Entry::Leaf(disc(Vec3::Y * 20.0, Vec3::NEG_Y, 1e-3, Vec3::ONE)),
            false => Entry::Inner(Bound { center: Vec3::Y * 20.0, radius: 20.0 }),
        }
    }

    fn children(&self, node: u32, mut visit: impl FnMut(u32)) {
        visit(node + 1);
        visit(node + 2);
    }

    fn sent(&self, _: u32, _: Vec3) -> Sent {
        Sent::default()
    }
}

#[test]
fn a_chain_of_100_000_nodes_is_walked() {
    let buffer = MicroBuffer::new(Shape::Cube, 8);
    let found = gather(&Chain(100_000), &white(Vec3::ZERO, Vec3::Y), &buffer);
    let expected = 100_001.0 * 1e-6 / 400.0;
    assert!((found.radiance.x / expected - 1.0).abs() < 0.01, "{found:?} {expected}");
}
