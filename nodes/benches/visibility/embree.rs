//! Embree 4 for comparison only, opened at run time: the library is no dependency of anything.
//!
//! Layouts and numbers are those of Embree 4's public interface (`rtcore_*.h`).

use crate::rays::{Found, Rays};
use crate::scenes::Scene;
use libloading::{Library, Symbol};
use std::ffi::{CStr, c_char, c_void};
use std::ptr::{null, null_mut};

type Handle = *mut c_void;

/// `RTCOccludedArguments` and `RTCIntersectArguments`, which agree.
#[repr(C)]
struct Arguments {
    flags: u32,
    features: u32,
    context: *const c_void,
    filter: *const c_void,
    function: *const c_void,
}

const COHERENT: u32 = 1 << 16;

impl Arguments {
    fn new(coherent: bool) -> Self {
        let flags = if coherent { COHERENT } else { 0 };
        Self { flags, features: u32::MAX, context: null(), filter: null(), function: null() }
    }
}

/// `RTCRayN`: each field N times. Aligned as the widest one asks.
#[repr(C, align(64))]
struct Packet<const N: usize> {
    origin: [[f32; N]; 3],
    near: [f32; N],
    direction: [[f32; N]; 3],
    time: [f32; N],
    far: [f32; N],
    mask: [u32; N],
    id: [u32; N],
    flags: [u32; N],
}

/// `RTCRayHit`, with room for both numbers of the instance.
#[repr(C, align(16))]
struct RayHit {
    ray: Single,
    normal: [f32; 3],
    uv: [f32; 2],
    triangle: u32,
    geometry: u32,
    instance: [u32; 4],
}

/// `RTCRay`.
#[repr(C, align(16))]
struct Single {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
}

impl Single {
    fn of(rays: &Rays, i: usize, far: f32) -> Self {
        Self {
            origin: [0, 1, 2].map(|k| rays.origin[k][i]),
            near: 0.0,
            direction: [0, 1, 2].map(|k| rays.direction[k][i]),
            time: 0.0,
            far,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
    }
}

type OccludedN = unsafe extern "C" fn(*const i32, Handle, *mut c_void, *const Arguments);

/// The open library and one device that works on the calling thread.
pub struct Embree {
    library: Library,
    device: Handle,
}

/// How carefully Embree builds: the values of `RTCBuildQuality`.
#[derive(Clone, Copy)]
pub enum Quality {
    Low = 0,
    Medium = 1,
}

impl Embree {
    /// Opens the library at `path`; the error says what is wrong.
    pub fn open(path: &str) -> Result<Self, String> {
        // SAFETY: the user names a copy of Embree, whose initialisers do nothing but initialise.
        let library = unsafe { Library::new(path) }.map_err(|e| e.to_string())?;
        let mut embree = Self { library, device: null_mut() };
        let config = c"threads=1,user_threads=1";
        embree.device = embree.create(config)?;
        Ok(embree)
    }

    fn create(&self, config: &CStr) -> Result<Handle, String> {
        type Create = unsafe extern "C" fn(*const c_char) -> Handle;
        // SAFETY: the signature is Embree 4's.
        let device = unsafe { self.symbol::<Create>("rtcNewDevice")(config.as_ptr()) };
        if device.is_null() { Err("rtcNewDevice gave none".into()) } else { Ok(device) }
    }

    /// `RTC_DEVICE_PROPERTY_VERSION`, as 40400 for 4.4.0.
    pub fn version(&self) -> isize {
        type Property = unsafe extern "C" fn(Handle, u32) -> isize;
        // SAFETY: the signature is Embree 4's and the device is open.
        unsafe { self.symbol::<Property>("rtcGetDeviceProperty")(self.device, 0) }
    }

    /// A function of the library.
    ///
    /// # Safety
    /// `T` must be its signature.
    unsafe fn symbol<T>(&self, name: &str) -> Symbol<'_, T> {
        // SAFETY: the caller vouches for the signature.
        unsafe { self.library.get(name.as_bytes()) }.expect("a function of Embree 4")
    }

    fn scene(&self, quality: Quality) -> Handle {
        type Make = unsafe extern "C" fn(Handle) -> Handle;
        type Set = unsafe extern "C" fn(Handle, u32);
        // SAFETY: the signatures are Embree 4's and the device is open.
        unsafe {
            let scene = self.symbol::<Make>("rtcNewScene")(self.device);
            self.symbol::<Set>("rtcSetSceneBuildQuality")(scene, quality as u32);
            scene
        }
    }

    /// Adds a geometry that `fill` completes, of the given `RTCGeometryType`.
    fn attach(&self, scene: Handle, kind: u32, fill: impl FnOnce(Handle)) {
        type Make = unsafe extern "C" fn(Handle, u32) -> Handle;
        type Use = unsafe extern "C" fn(Handle);
        type Attach = unsafe extern "C" fn(Handle, Handle) -> u32;
        // SAFETY: the signatures are Embree 4's; the geometry is released once the scene holds it.
        unsafe {
            let geometry = self.symbol::<Make>("rtcNewGeometry")(self.device, kind);
            fill(geometry);
            self.symbol::<Use>("rtcCommitGeometry")(geometry);
            self.symbol::<Attach>("rtcAttachGeometry")(scene, geometry);
            self.symbol::<Use>("rtcReleaseGeometry")(geometry);
        }
    }

    fn attach_triangles(&self, scene: Handle, vertices: &[[f32; 3]], indices: &[[u32; 3]]) {
        type Share =
            unsafe extern "C" fn(Handle, u32, u32, u32, *const c_void, usize, usize, usize);
        self.attach(scene, 0, |geometry| {
            // SAFETY: the signature is Embree 4's; the buffers outlive the scene, and the vertices' last one is
            // padded to 16 bytes.
            unsafe {
                let share = self.symbol::<Share>("rtcSetSharedGeometryBuffer");
                share(geometry, 0, 0, 0x5003, indices.as_ptr().cast(), 0, 12, indices.len());
                share(geometry, 1, 0, 0x9003, vertices.as_ptr().cast(), 0, 12, vertices.len() - 1);
            }
        });
    }

    fn attach_instance(&self, scene: Handle, mesh: Handle, to_world: &glam::Affine3A) {
        type Of = unsafe extern "C" fn(Handle, Handle);
        type Place = unsafe extern "C" fn(Handle, u32, u32, *const f32);
        let columns = to_world.to_cols_array();
        self.attach(scene, 121, |geometry| {
            // SAFETY: the signatures are Embree 4's; the matrix is copied.
            unsafe {
                self.symbol::<Of>("rtcSetGeometryInstancedScene")(geometry, mesh);
                let place = self.symbol::<Place>("rtcSetGeometryTransform");
                place(geometry, 0, 0x9234, columns.as_ptr());
            }
        });
    }

    fn commit(&self, scene: Handle) {
        type Use = unsafe extern "C" fn(Handle);
        // SAFETY: the signature is Embree 4's and the scene is open.
        unsafe { self.symbol::<Use>("rtcCommitScene")(scene) };
    }

    fn release(&self, scene: Handle) {
        type Use = unsafe extern "C" fn(Handle);
        // SAFETY: the signature is Embree 4's and the scene is used no more.
        unsafe { self.symbol::<Use>("rtcReleaseScene")(scene) };
    }

    /// Builds a scene with buffers of its own. A mesh that is placed once, where it stands, is no instance.
    pub fn build(&self, source: &Scene, quality: Quality) -> EmbreeScene<'_> {
        let buffers: Vec<_> = source.meshes.iter().map(|mesh| Buffers::of(mesh)).collect();
        let mut built = EmbreeScene { embree: self, scenes: Vec::new(), buffers };
        let root = self.scene(quality);
        let mut of_mesh: Vec<Handle> = vec![null_mut(); source.meshes.len()];
        for (mesh, to_world) in &source.places {
            let buffers = &built.buffers[*mesh];
            if *to_world == glam::Affine3A::IDENTITY {
                self.attach_triangles(root, &buffers.vertices, &buffers.indices);
                continue;
            }
            if of_mesh[*mesh].is_null() {
                let scene = self.scene(quality);
                self.attach_triangles(scene, &buffers.vertices, &buffers.indices);
                self.commit(scene);
                of_mesh[*mesh] = scene;
            }
            self.attach_instance(root, of_mesh[*mesh], to_world);
        }
        self.commit(root);
        built.scenes.push(root);
        built.scenes.extend(of_mesh.into_iter().filter(|scene| !scene.is_null()));
        built
    }
}

/// One mesh as Embree reads it; one vertex more than there are, because Embree reads 16 bytes of each.
struct Buffers {
    vertices: Vec<[f32; 3]>,
    indices: Vec<[u32; 3]>,
}

impl Buffers {
    fn of(mesh: &[[glam::Vec3; 3]]) -> Self {
        let mut vertices: Vec<_> = mesh.iter().flatten().map(|v| v.to_array()).collect();
        vertices.push([0.0; 3]);
        let indices = (0..mesh.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Self { vertices, indices }
    }
}

/// A committed scene.
pub struct EmbreeScene<'a> {
    embree: &'a Embree,
    /// The root comes first.
    scenes: Vec<Handle>,
    buffers: Vec<Buffers>,
}

impl Drop for EmbreeScene<'_> {
    fn drop(&mut self) {
        self.scenes.iter().for_each(|&scene| self.embree.release(scene));
        self.buffers.clear();
    }
}

impl EmbreeScene<'_> {
    /// `rtcOccluded1` for each ray.
    pub fn occluded1(&self, rays: &Rays, blocked: &mut [bool]) {
        type Occluded = unsafe extern "C" fn(Handle, *mut Single, *const Arguments);
        // SAFETY: the signature is Embree 4's.
        let occluded = unsafe { self.embree.symbol::<Occluded>("rtcOccluded1") };
        let arguments = Arguments::new(false);
        for (i, blocked) in blocked.iter_mut().enumerate() {
            let mut ray = Single::of(rays, i, 1.0);
            // SAFETY: the scene is committed, the ray is aligned.
            unsafe { occluded(self.scenes[0], &mut ray, &arguments) };
            *blocked = ray.far < 0.0;
        }
    }

    /// `rtcOccludedN` for each N rays.
    pub fn occluded_n<const N: usize>(&self, rays: &Rays, coherent: bool, blocked: &mut [bool]) {
        // SAFETY: the signature is Embree 4's; only the widths that it has are asked for.
        let occluded = unsafe { self.embree.symbol::<OccludedN>(&format!("rtcOccluded{N}")) };
        let arguments = Arguments::new(coherent);
        let mut packet = Packet::<N> {
            origin: [[0.0; N]; 3],
            near: [0.0; N],
            direction: [[0.0; N]; 3],
            time: [0.0; N],
            far: [1.0; N],
            mask: [u32::MAX; N],
            id: [0; N],
            flags: [0; N],
        };
        #[repr(C, align(64))]
        struct Valid<const N: usize>([i32; N]);
        for (chunk, blocked) in blocked.chunks_mut(N).enumerate() {
            let (first, count) = (chunk * N, blocked.len());
            let mut valid = Valid([0; N]);
            valid.0[..count].fill(-1);
            for k in 0..3 {
                packet.origin[k][..count].copy_from_slice(&rays.origin[k][first..][..count]);
                packet.direction[k][..count].copy_from_slice(&rays.direction[k][first..][..count]);
            }
            packet.far = [1.0; N];
            // SAFETY: the scene is committed, the packet and the mask are aligned to 64 bytes.
            unsafe {
                let packet = std::ptr::from_mut(&mut packet).cast();
                occluded(valid.0.as_ptr(), self.scenes[0], packet, &arguments);
            }
            for (blocked, far) in blocked.iter_mut().zip(packet.far) {
                *blocked = far < 0.0;
            }
        }
    }

    /// `rtcIntersect1` for each ray, without end.
    pub fn closest(&self, rays: &Rays, found: &mut [Found]) {
        type Intersect = unsafe extern "C" fn(Handle, *mut RayHit, *const Arguments);
        // SAFETY: the signature is Embree 4's.
        let intersect = unsafe { self.embree.symbol::<Intersect>("rtcIntersect1") };
        let arguments = Arguments::new(false);
        for (i, found) in found.iter_mut().enumerate() {
            let mut hit = RayHit {
                ray: Single::of(rays, i, f32::INFINITY),
                normal: [0.0; 3],
                uv: [0.0; 2],
                triangle: u32::MAX,
                geometry: u32::MAX,
                instance: [u32::MAX; 4],
            };
            // SAFETY: the scene is committed, the ray is aligned.
            unsafe { intersect(self.scenes[0], &mut hit, &arguments) };
            *found = Found(hit.ray.far);
        }
    }
}
