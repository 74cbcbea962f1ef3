//! Small scenes, shots and pipelines for the tests that use nodes as a plain library.

use glam::{DVec3, Mat4, Vec2, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{
    Camera, Clusters, DeepFramebuffer, Geometry, Image, LightKind, Lights, Materials, PixelMaps,
    Poses, Representatives, Rows, alpha, instance,
};
use nodes::kernel::element::Light;
use nodes::kernel::light_list::LightList;
use nodes::node::{All, Ctx, Error, Item, Node, Window};

/// Three corners and a material.
pub type Triangle = ([Vec3; 3], u32);

/// Lambertian materials without textures: albedo and emitted radiance.
pub fn materials(surfaces: &[(Vec3, Vec3)]) -> Materials {
    let n = surfaces.len();
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    Materials {
        base_colour: surfaces.iter().map(|(a, _)| [a.x, a.y, a.z, 1.0]).collect(),
        metallic_roughness: vec![[0.0, 1.0]; n].into(),
        specular_factor: vec![0.0; n].into(),
        emissive: surfaces.iter().map(|(_, e)| *e).collect(),
        alpha_mode: vec![[alpha::OPAQUE, 0.5]; n].into(),
        double_sided: vec![0; n].into(),
        material_texture: vec![[-1.0; 3]; n].into(),
        texture_transform: vec![std::array::from_fn(|i| identity[i % 6]); n].into(),
        texture: Vec::new().into(),
        texel: Vec::new().into(),
    }
}

/// One mesh of flat triangles for each part, the first static, the others moved by their matrices.
pub fn soups(parts: &[Vec<Triangle>]) -> Geometry {
    let position: Vec<Vec3> = parts.iter().flatten().flat_map(|t| t.0).collect();
    let finite = || position.iter().copied().filter(|p| p.is_finite());
    let low = finite().reduce(Vec3::min).unwrap_or_default();
    let high = finite().reduce(Vec3::max).unwrap_or_default();
    let diagonal = (high - low).length();
    let mut mesh = Vec::new();
    let mut first = 0;
    for part in parts {
        let count = part.len() as u32;
        mesh.push([first, count, 3 * first, 3 * count]);
        first += count;
    }
    let motion = |i: usize| if i == 0 { instance::STATIC } else { instance::RIGID };
    Geometry {
        normal: vec![Vec3::ZERO; position.len()].into(),
        uv: vec![Vec2::ZERO; position.len()].into(),
        position: position.into(),
        colour: Vec::new().into(),
        joint: Vec::new().into(),
        weight: Vec::new().into(),
        triangle: (0..first).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        triangle_material: parts.iter().flatten().map(|t| t.1).collect(),
        mesh: mesh.into(),
        morph_target: Vec::new().into(),
        morph_position: Vec::new().into(),
        morph_normal: Vec::new().into(),
        instance: (0..parts.len()).map(|i| [i as u32, instance::NO_SKIN, motion(i)]).collect(),
        centre: (low + high) * 0.5,
        diagonal,
        bias: 1e-4 * diagonal,
    }
}

/// One matrix an instance.
pub fn poses(matrices: &[Mat4]) -> Poses {
    Poses {
        matrix: matrices.iter().map(Mat4::to_cols_array).collect(),
        weight_range: vec![[0, 0]; matrices.len()].into(),
        weight: Vec::new().into(),
        joint_range: vec![[0, 0]; matrices.len()].into(),
        joint: Vec::new().into(),
    }
}

/// The parallelogram at `corner` with sides `u` and `v`; front: u x v.
pub fn quad(corner: Vec3, u: Vec3, v: Vec3, material: u32) -> [Triangle; 2] {
    [
        ([corner, corner + u, corner + u + v], material),
        ([corner, corner + u + v, corner + v], material),
    ]
}

/// A square plane at y = 0 around the origin, facing up, of material 0.
pub fn plane(side: f32) -> Vec<Triangle> {
    quad(Vec3::new(-0.5, 0.0, -0.5) * side, Vec3::Z * side, Vec3::X * side, 0).to_vec()
}

/// The outside of a box, of material 0.
pub fn block(low: Vec3, size: Vec3) -> Vec<Triangle> {
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    let sides =
        [(low + y, z, x), (low, x, z), (low, y, x), (low + z, x, y), (low, z, y), (low + x, y, z)];
    sides.into_iter().flat_map(|(corner, u, v)| quad(corner, u, v, 0)).collect()
}

/// The inside of the unit cube: material 0, with a wall of material 1 and one of material 2.
pub fn room() -> Vec<Triangle> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let sides = [(Vec3::ZERO, z, x, 0), (y, x, z, 0), (Vec3::ZERO, x, y, 0), (z, y, x, 0)];
    let walls = [(Vec3::ZERO, y, z, 1), (x, z, y, 2)];
    sides.into_iter().chain(walls).flat_map(|(corner, u, v, m)| quad(corner, u, v, m)).collect()
}

/// A unit sphere of 20 x 4^levels triangles, facing inwards, of material 0.
pub fn sphere(levels: u32) -> Vec<Triangle> {
    let octant = |i: usize| {
        let side = |bit: usize| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let corners = [Vec3::X * side(0), Vec3::Y * side(1), Vec3::Z * side(2)];
        // Inwards: the mirrored octants turn round.
        if side(0) * side(1) * side(2) > 0.0 {
            [corners[0], corners[2], corners[1]]
        } else {
            corners
        }
    };
    let mut faces: Vec<[Vec3; 3]> = (0..8).map(octant).collect();
    for _ in 0..levels {
        let quarter = |[a, b, c]: [Vec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(Vec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        faces = faces.into_iter().flat_map(quarter).collect();
    }
    faces.into_iter().map(|face| (face, 0)).collect()
}

/// A perspective camera that looks from `eye` to `at` with the given tangent of half its height.
pub fn look(eye: Vec3, at: Vec3, tangent: f32) -> Camera {
    let forward = (at - eye).normalize();
    let across = if forward.y.abs() > 0.99 { Vec3::NEG_Z } else { Vec3::Y };
    let right = forward.cross(across).normalize();
    Camera {
        eye,
        right,
        up: right.cross(forward),
        forward,
        half_height_tangent: tangent,
        half_height: 0.0,
        clip: [0.0, f32::MAX],
    }
}

/// A light of a kind at a place, pointing somewhere, without cone and clamp.
pub fn lamp(kind: LightKind, position: Vec3, direction: Vec3, emission: Vec3) -> Light {
    Light { kind, position, direction, emission, cone: Vec2::ZERO, clamp: 0.0 }
}

/// A list of lights that are the same in every frame.
pub fn lights(all: &[Light]) -> Item<Lights> {
    let mut list = LightList::new();
    all.iter().for_each(|light| list.push(light));
    list.finish(true).into()
}

/// The list with every emission times `factor`.
pub fn scaled(lights: &Lights, factor: f32) -> Item<Lights> {
    let emission = lights.emission.iter().map(|e| *e * factor).collect();
    Lights { emission, ..lights.clone() }.into()
}

/// One frame: what is traced, shaded and seen.
#[derive(Clone)]
pub struct Frame {
    pub geometry: Item<Geometry>,
    pub materials: Item<Materials>,
    pub poses: Item<Poses>,
    pub camera: Item<Camera>,
    pub framebuffer: Item<DeepFramebuffer>,
}

impl Frame {
    /// A frame of instances at `matrices`, seen in `size` pixels.
    pub fn new(
        geometry: Geometry,
        materials: Materials,
        matrices: &[Mat4],
        camera: Camera,
        size: [u32; 2],
    ) -> Frame {
        Frame::posed(&geometry.into(), &materials.into(), matrices, camera, size)
    }

    /// A frame of a shot: as [`Frame::new`] with parts that other frames share.
    pub fn posed(
        geometry: &Item<Geometry>,
        materials: &Item<Materials>,
        matrices: &[Mat4],
        camera: Camera,
        size: [u32; 2],
    ) -> Frame {
        let (geometry, materials) = (geometry.clone(), materials.clone());
        let (poses, camera) = (Item::from(poses(matrices)), Item::from(camera));
        let input = nodes::DeepFramebufferIn {
            geometry: geometry.clone(),
            materials: materials.clone(),
            poses: poses.clone(),
            camera: camera.clone(),
            environment: None,
        };
        let node = nodes::DeepFramebuffer { size, min_roughness: 0.3 };
        let framebuffer = node.run(input, &Ctx::default()).expect("a framebuffer").into();
        Frame { geometry, materials, poses, camera, framebuffer }
    }

    /// A still of static triangles.
    pub fn still(
        triangles: Vec<Triangle>,
        materials: Materials,
        camera: Camera,
        size: [u32; 2],
    ) -> Frame {
        Frame::new(soups(&[triangles]), materials, &[Mat4::IDENTITY], camera, size)
    }

    /// The brute-force sum over `lights`.
    pub fn reference(&self, lights: &Item<Lights>) -> Image {
        let input = nodes::ReferenceIn {
            framebuffer: self.framebuffer.clone(),
            lights: Some(lights.clone()),
            geometry: self.geometry.clone(),
            materials: self.materials.clone(),
            poses: self.poses.clone(),
        };
        nodes::Reference {}.run(input, &Ctx::default()).expect("a reference")
    }

    /// Rows of `lights` at one pixel in each bin.
    pub fn rows(&self, lights: &Item<Lights>, bins: [u32; 2]) -> Result<Rows, Error> {
        let input = nodes::RowsIn {
            framebuffer: self.framebuffer.clone(),
            lights: lights.clone(),
            geometry: self.geometry.clone(),
            materials: self.materials.clone(),
            poses: self.poses.clone(),
        };
        nodes::Rows { bins }.run(input, &Ctx::default())
    }

    /// Lights of the emitting surfaces.
    pub fn emissive(&self, count: u32) -> Lights {
        let input = nodes::EmissiveLightsIn {
            geometry: self.geometry.clone(),
            materials: self.materials.clone(),
            poses: self.poses.clone(),
            rest: None,
        };
        nodes::EmissiveLights { count, clamp: 0.02, seed: 1 }
            .run(input, &Ctx::default())
            .expect("lights")
    }

    /// Virtual lights of photons that `lights` emit.
    pub fn photon_lights(&self, lights: &Item<Lights>, count: u32) -> Lights {
        let input = nodes::PhotonLightsIn {
            geometry: self.geometry.clone(),
            materials: self.materials.clone(),
            poses: self.poses.clone(),
            lights: lights.clone(),
        };
        nodes::PhotonLights { count, clamp: 0.02, seed: 1 }
            .run(input, &Ctx::default())
            .expect("lights")
    }

    /// Photons of `direct` lights without their first hit, and of `area` lights with it.
    pub fn photons(
        &self,
        direct: Option<&Item<Lights>>,
        area: Option<&Item<Lights>>,
        count: u32,
    ) -> nodes::data::Photons {
        let input = nodes::PhotonsIn {
            geometry: self.geometry.clone(),
            materials: self.materials.clone(),
            poses: self.poses.clone(),
            direct: direct.cloned(),
            area: area.cloned(),
        };
        nodes::Photons { count, seed: 1 }.run(input, &Ctx::default()).expect("photons")
    }

    /// Gather samples on front faces, at the places of this frame.
    pub fn gather_samples(&self, count: u32) -> Result<nodes::data::GatherSamples, Error> {
        let input = nodes::GatherSamplesIn {
            geometry: self.geometry.clone(),
            materials: self.materials.clone(),
            rest: self.poses.clone(),
        };
        nodes::GatherSamples { count, sides: nodes::Sides::Front, seed: 1 }
            .run(input, &Ctx::default())
    }

    /// The samples as lights.
    pub fn gather_lights(
        &self,
        samples: &Item<nodes::data::GatherSamples>,
        direct: Option<&Item<Lights>>,
        photons: Option<nodes::data::Photons>,
        nearest: u32,
    ) -> Lights {
        let input = nodes::GatherLightsIn {
            samples: samples.clone(),
            geometry: self.geometry.clone(),
            materials: self.materials.clone(),
            poses: self.poses.clone(),
            direct: direct.cloned(),
            photons: photons.map(Item::from),
        };
        let node = nodes::GatherLights { nearest, radius: 0.05, clamp: 0.02 };
        node.run(input, &Ctx::default()).expect("lights")
    }
}

/// Frames with the lights and rows of each.
#[derive(Clone, Default)]
pub struct Shot {
    pub frames: Vec<Frame>,
    pub lights: Vec<Item<Lights>>,
    pub rows: Vec<Item<Rows>>,
}

impl Shot {
    /// The frames with their lights and rows of them.
    pub fn new(frames: Vec<Frame>, lights: Vec<Item<Lights>>, bins: [u32; 2]) -> Shot {
        let rows = frames
            .iter()
            .zip(&lights)
            .map(|(f, l)| f.rows(l, bins).expect("rows").into())
            .collect();
        Shot { frames, lights, rows }
    }

    pub fn all_rows(&self) -> All<Rows> {
        self.rows.clone().into()
    }

    pub fn reference(&self) -> Vec<Image> {
        self.frames
            .iter()
            .zip(&self.lights)
            .map(|(frame, lights)| frame.reference(lights))
            .collect()
    }

    /// Maps between neighbouring frames.
    pub fn maps(&self) -> Vec<Item<PixelMaps>> {
        self.frames.windows(2).map(|pair| maps(&pair[0], &pair[1]).into()).collect()
    }

    /// Clusters over lights and time.
    pub fn clusters(&self, start: u32, limit: u32, maps: &[Item<PixelMaps>]) -> Clusters {
        let input = nodes::ClustersIn { rows: self.all_rows(), maps: Some(maps.to_vec().into()) };
        let node = nodes::Clusters { start, limit, ..Default::default() };
        node.run(input, &Ctx::default()).expect("clusters")
    }

    /// Clusters of each frame by itself.
    pub fn column_clusters(&self, count: u32) -> Clusters {
        let node = nodes::ColumnClusters { count, ..Default::default() };
        node.run(nodes::ColumnClustersIn { rows: self.all_rows() }, &Ctx::default())
            .expect("clusters")
    }

    pub fn representatives(
        &self,
        clusters: &Item<Clusters>,
        node: &nodes::Representatives,
    ) -> Representatives {
        let input = nodes::RepresentativesIn { clusters: clusters.clone(), rows: self.all_rows() };
        node.run(input, &Ctx::default()).expect("representatives")
    }

    /// What Reconstruct takes.
    pub fn to_reconstruct(
        &self,
        representatives: Representatives,
        maps: &[Item<PixelMaps>],
    ) -> nodes::ReconstructIn {
        let all =
            |f: fn(&Frame) -> Item<DeepFramebuffer>| self.frames.iter().map(f).collect::<Vec<_>>();
        nodes::ReconstructIn {
            representatives: representatives.into(),
            framebuffer: all(|f| f.framebuffer.clone()).into(),
            lights: self.lights.clone().into(),
            geometry: self.frames[0].geometry.clone(),
            materials: self.frames[0].materials.clone(),
            poses: self.frames.iter().map(|f| f.poses.clone()).collect::<Vec<_>>().into(),
            maps: (!maps.is_empty()).then(|| maps.to_vec().into()),
        }
    }

    pub fn reconstruct(
        &self,
        representatives: Representatives,
        maps: &[Item<PixelMaps>],
    ) -> Vec<Image> {
        let input = self.to_reconstruct(representatives, maps);
        nodes::Reconstruct {}.run(input, &Ctx::default()).expect("images").items
    }

    /// From the rows to the images with `count` columns a frame.
    pub fn render(&self, start: u32, count: u32) -> Vec<Image> {
        let maps = self.maps();
        let clusters = self.clusters(start, count, &maps).into();
        let node = nodes::Representatives { count, ..Default::default() };
        self.reconstruct(self.representatives(&clusters, &node), &maps)
    }
}

/// The maps between two frames.
pub fn maps(this: &Frame, next: &Frame) -> PixelMaps {
    let framebuffer = Window { this: this.framebuffer.clone(), next: next.framebuffer.clone() };
    let input = nodes::PixelMapsIn { framebuffer, geometry: this.geometry.clone() };
    nodes::PixelMaps::default().run(input, &Ctx::default()).expect("maps")
}

/// |image - reference| / |reference| over all images.
pub fn relative_l2(images: &[Image], references: &[Image]) -> f64 {
    assert_eq!(images.len(), references.len());
    let pixels = |all: &[Image]| {
        all.iter().flat_map(|i| i.radiance.to_vec()).map(|p| p.as_dvec3()).collect::<Vec<DVec3>>()
    };
    let (image, reference) = (pixels(images), pixels(references));
    assert_eq!(image.len(), reference.len());
    let square = |v: DVec3| v.length_squared();
    let distance: f64 = image.iter().zip(&reference).map(|(i, r)| square(*i - *r)).sum();
    let norm: f64 = reference.iter().map(|r| square(*r)).sum();
    assert!(norm > 0.0, "a black reference tells nothing");
    (distance / norm).sqrt()
}

/// Whether two images have the same bits.
pub fn same(a: &Image, b: &Image) -> bool {
    nodes::data::encode(a) == nodes::data::encode(b)
}

/// The room with a block in it that turns, seen by a camera that moves: `count` frames.
pub fn turning_room(count: u32, size: [u32; 2]) -> Vec<Frame> {
    let parts = [room(), block(Vec3::new(-0.15, 0.0, -0.15), Vec3::new(0.3, 0.4, 0.3))];
    let surfaces = [Vec3::splat(0.7), Vec3::new(0.7, 0.1, 0.1), Vec3::new(0.1, 0.7, 0.1)]
        .map(|a| (a, Vec3::ZERO));
    let (geometry, materials) = (soups(&parts).into(), materials(&surfaces).into());
    let frame = |k: u32| {
        let step = k as f32;
        let turn =
            Mat4::from_translation(Vec3::new(0.55, 0.0, 0.45)) * Mat4::from_rotation_y(0.06 * step);
        let camera =
            look(Vec3::new(0.42 + 0.015 * step, 0.6, 0.97), Vec3::new(0.5, 0.35, 0.3), 0.6);
        Frame::posed(&geometry, &materials, &[Mat4::IDENTITY, turn], camera, size)
    };
    (0..count).map(frame).collect()
}

/// The gather lights of every frame of a shot, lit by a lamp that moves and dims.
pub fn gathered(frames: &[Frame], count: u32) -> Vec<Item<Lights>> {
    let samples: Item<_> = frames[0].gather_samples(count).expect("samples").into();
    let lit = |(k, frame): (usize, &Frame)| {
        let step = k as f32;
        let place = Vec3::new(0.2 + 0.03 * step, 0.85, 0.4);
        let lamp =
            lamp(LightKind::Omni, place, Vec3::Y, Vec3::new(1.0, 0.9, 0.7) * (1.0 - 0.03 * step));
        Item::from(frame.gather_lights(&samples, Some(&lights(&[lamp])), None, 50))
    };
    frames.iter().enumerate().map(lit).collect()
}
