//! Small scenes, shots and pipelines for the tests that use nodes as a plain library.

mod parts;

pub use parts::*;

use glam::{DVec3, Mat4, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{
    Camera, Clusters, DeepFramebuffer, Geometry, Image, LightKind, Lights, Materials, PixelMaps,
    Poses, Representatives, Rows,
};
use nodes::node::{All, Ctx, Error, Item, Node, Window};

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
