//! One column of the lighting tensor, shader and structs: A(i, j) for one light j and every receiver
//! i (Hašan et al. 2008, section 4.2).

use bytemuck::{Pod, Zeroable};

/// The WGSL of the column shader. Its entry point is `main`, one invocation a receiver, with the
/// bindings of group 0:
///
/// | binding | buffer | content |
/// |---|---|---|
/// | 0 | storage, read | `[receiver]` [`GpuReceiver`] |
/// | 1 | uniform | one [`GpuLight`] |
/// | 2 | storage, read | `[receiver / 32]` `u32`, rounded up: bit `i % 32` of word `i / 32` is set where something stands between receiver i and the light; all zero is the column without visibility |
/// | 3 | storage, written | `[receiver, 3]` `f32`: radiance towards the eye, W/(m^2 sr), linear RGB |
///
/// A little-endian `u64` of blocked bits for 64 receivers is two words of binding 2 as it lies in
/// memory. The length of binding 0 is the number of receivers; at the 128 MiB that WebGPU promises
/// it holds 1.7 million. Inputs must be finite. A device may fuse multiplications with additions and
/// round divisions its own way, so the results equal the CPU's to a tolerance, not to the bit, and
/// where a product overflows WGSL promises nothing.
pub const ELEMENT: &str = include_str!("element.wgsl");

/// Invocations of a workgroup of [`ELEMENT`]: dispatch the number of receivers divided by this,
/// rounded up.
pub const WORKGROUP: u32 = 64;

/// A surface sample that is lit; `Receiver` in [`ELEMENT`]. Vectors are in world space.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuReceiver {
    /// Metres.
    pub position: [f32; 3],
    /// Unit shading normal, towards the eye.
    pub normal: [f32; 3],
    /// Unit normal of the triangle, towards the eye: light from behind it adds nothing.
    pub facet: [f32; 3],
    /// Unit vector to the eye.
    pub to_eye: [f32; 3],
    /// Diffuse reflectance, linear RGB, 0 to 1.
    pub albedo: [f32; 3],
    /// Specular reflectance at normal incidence, linear RGB, 0 to 1; zero is exactly Lambertian.
    pub specular: [f32; 3],
    /// Perceptual roughness, 0 to 1.
    pub roughness: f32,
}

/// A light; `Light` in [`ELEMENT`]. Vectors are in world space.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuLight {
    /// Metres; unused for directional lights.
    pub position: [f32; 3],
    /// 0 omni, 1 spot, 2 directional, 3 cosine; others are read as omni.
    pub kind: u32,
    /// Unit vector along which it shines; unused for omni lights.
    pub direction: [f32; 3],
    /// Distance below which 1/r^2 is held constant, metres; unused for directional lights.
    pub clamp: f32,
    /// Linear RGB: intensity, W/sr (of a spot along its axis, of a cosine light along its normal),
    /// or the perpendicular irradiance of a directional light, W/m^2.
    pub emission: [f32; 3],
    /// Cosine of the cone inside which a spot has its full intensity.
    pub cone_inner: f32,
    /// Cosine of the cone outside which a spot is dark.
    pub cone_outer: f32,
    /// Fills the struct to the 16 bytes to which uniforms are aligned; never read.
    pub padding: [u32; 3],
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{differences, members, parse};

    #[test]
    fn structs_lie_in_memory_as_the_shader_reads_them() {
        let module = parse(ELEMENT);
        assert_eq!(differences::<GpuReceiver>(&module, "Receiver", &receiver()), [""; 0]);
        assert_eq!(differences::<GpuLight>(&module, "Light", &light()), [""; 0]);
    }

    #[test]
    fn a_moved_renamed_or_retyped_member_is_found() {
        let edits = [
            ("clamp: f32,\n    emission: vec3f,", "emission: vec3f,\n    clamp: f32,"),
            ("cone_inner: f32,\n    cone_outer: f32,", "cone_outer: f32,\n    cone_inner: f32,"),
            ("    cone_outer: f32,\n}", "    cone_outer: f32,\n    more: f32,\n}"),
            ("    kind: u32,\n", "    kind: i32,\n"),
            ("    kind: u32,\n", ""),
        ];
        for (from, to) in edits {
            assert_eq!(ELEMENT.matches(from).count(), 1, "{from}");
            let text = ELEMENT.split("@group").next().unwrap_or_default().replace(from, to);
            assert!(!differences::<GpuLight>(&parse(&text), "Light", &light()).is_empty(), "{to}");
        }
    }

    #[test]
    fn bindings_and_workgroup_are_the_documented_ones() {
        let module = parse(ELEMENT);
        assert_eq!(module.entry_points.len(), 1);
        assert_eq!(module.entry_points[0].name, "main");
        assert_eq!(module.entry_points[0].workgroup_size, [WORKGROUP, 1, 1]);
        let layouts = crate::layout::bindings(&module);
        let receiver = size_of::<GpuReceiver>();
        let expected = [
            format!("0 receivers: storage read, stride {receiver}"),
            "1 light: uniform".to_owned(),
            "2 blocked: storage read, stride 4".to_owned(),
            "3 column: storage read write, stride 12".to_owned(),
        ];
        assert_eq!(layouts, expected);
    }

    fn receiver() -> Vec<crate::layout::Member> {
        members!(GpuReceiver { position, normal, facet, to_eye, albedo, specular, roughness })
    }

    fn light() -> Vec<crate::layout::Member> {
        members!(GpuLight {
            position,
            kind,
            direction,
            clamp,
            emission,
            cone_inner,
            cone_outer,
            padding
        })
    }
}
