// One column of the lighting tensor: what one light adds to the radiance of every receiver (Hašan et
// al. 2008, section 4.2), in the operations and their order of the renderer's CPU kernels for the
// matrix element and the BRDF. Shadow rays are answered elsewhere; `blocked` holds their answers.
// Structs, units and frames: element.rs.

// Three floats without the padding of vec3f, which only storage buffers allow.
alias Packed = array<f32, 3>;

struct Receiver {
    position: Packed,
    normal: Packed,
    facet: Packed,
    to_eye: Packed,
    albedo: Packed,
    specular: Packed,
    roughness: f32,
}

struct Light {
    position: vec3f,
    kind: u32,
    direction: vec3f,
    clamp: f32,
    emission: vec3f,
    cone_inner: f32,
    cone_outer: f32,
}

@group(0) @binding(0) var<storage, read> receivers: array<Receiver>;
@group(0) @binding(1) var<uniform> light: Light;
@group(0) @binding(2) var<storage, read> blocked: array<u32>;
@group(0) @binding(3) var<storage, read_write> column: array<Packed>;

// Every other kind is omni.
const SPOT = 1u;
const DIRECTIONAL = 2u;
const COSINE = 3u;

const PI = 3.14159274f;
const MIN_POSITIVE = 0x1p-126f;
const MAX = 0x1.fffffep+127f;
// Smallest alpha of the specular lobe: below it the distribution overflows at the peak.
const MIN_ALPHA = 1e-3f;

fn unpack(packed: Packed) -> vec3f {
    return vec3f(packed[0], packed[1], packed[2]);
}

// The built-in leaves the order of the sum open.
fn inner(a: vec3f, b: vec3f) -> f32 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// What arrives at a receiver before its cosine; a factor of zero where nothing does.
struct Arrival {
    to_light: vec3f,
    factor: f32,
}

fn arrive(position: vec3f) -> Arrival {
    if light.kind == DIRECTIONAL {
        return Arrival(-light.direction, 1.0);
    }
    let to_light = light.position - position;
    let squared = inner(to_light, to_light);
    // A light on the sample itself has no direction, and one closer than the square root of the
    // smallest number none that is finite: nothing arrives from it.
    if squared < MIN_POSITIVE {
        return Arrival(vec3f(0.0), 0.0);
    }
    let unit = to_light / sqrt(squared);
    let cosine = -inner(light.direction, unit);
    var falloff = 1.0;
    if light.kind == COSINE {
        falloff = max(cosine, 0.0);
    } else if light.kind == SPOT {
        falloff = spot(cosine);
    }
    let bounded = max(max(squared, light.clamp * light.clamp), MIN_POSITIVE);
    return Arrival(unit, falloff / bounded);
}

// Falloff between the cones: the square of the linear interpolation of cosines.
fn spot(cosine: f32) -> f32 {
    if cosine <= light.cone_outer {
        return 0.0;
    }
    let linear = min((cosine - light.cone_outer) / max(light.cone_inner - light.cone_outer, 1e-6), 1.0);
    return linear * linear;
}

// glTF 2.0's metallic-roughness BRDF, appendix B.3.5, 1/sr; `cos_light` is positive.
fn brdf(receiver: Receiver, normal: vec3f, to_light: vec3f, cos_light: f32) -> vec3f {
    let to_eye = unpack(receiver.to_eye);
    let albedo = unpack(receiver.albedo);
    let specular = unpack(receiver.specular);
    let cos_eye = inner(normal, to_eye);
    if cos_eye <= 0.0 {
        return vec3f(0.0);
    }
    if all(specular == vec3f(0.0)) {
        return albedo / PI;
    }
    // Both directions are above the surface, so their sum is never zero.
    let sum = to_eye + to_light;
    let half_way = sum * (1.0 / sqrt(inner(sum, sum)));
    let grazing = clamp(1.0 - inner(to_eye, half_way), 0.0, 1.0);
    let schlick = grazing * grazing * grazing * grazing * grazing;
    // Reflectance at grazing angles is 1 for every real surface and fades with the dielectric's
    // strength, whose normal incidence is 4 % of it.
    let edge = min(max(specular.x, max(specular.y, specular.z)) * 25.0, 1.0);
    let fresnel = specular + max(vec3f(edge) - specular, vec3f(0.0)) * schlick;
    let dielectric = edge * (0.04 + 0.96 * schlick);
    return albedo * ((1.0 - dielectric) / PI)
        + fresnel * lobe(receiver.roughness, inner(normal, half_way), cos_eye, cos_light);
}

// Trowbridge-Reitz distribution times the height-correlated Smith visibility.
fn lobe(roughness: f32, cos_half: f32, cos_eye: f32, cos_light: f32) -> f32 {
    let alpha = max(roughness * roughness, MIN_ALPHA);
    let a2 = alpha * alpha;
    // 1 - cos^2 (1 - a^2), written so that the peak keeps its precision.
    let sin2 = max(1.0 - cos_half * cos_half, 0.0);
    let base = sin2 + cos_half * cos_half * a2;
    let distribution = a2 / max(PI * base * base, MIN_POSITIVE);
    let to_light = cos_eye * sqrt(cos_light * cos_light * (1.0 - a2) + a2);
    let to_eye = cos_light * sqrt(cos_eye * cos_eye * (1.0 - a2) + a2);
    return distribution * 0.5 / max(to_light + to_eye, MIN_POSITIVE);
}

// The matrix element: radiance towards the eye if nothing stands between, W/(m^2 sr).
fn element(receiver: Receiver) -> vec3f {
    if all(light.emission == vec3f(0.0)) {
        return vec3f(0.0);
    }
    let arrival = arrive(unpack(receiver.position));
    let normal = unpack(receiver.normal);
    let cosine = inner(normal, arrival.to_light);
    let guard = inner(unpack(receiver.facet), arrival.to_light);
    if arrival.factor <= 0.0 || cosine <= 0.0 || guard <= 0.0 {
        return vec3f(0.0);
    }
    let reflected = brdf(receiver, normal, arrival.to_light, cosine) * (arrival.factor * cosine);
    // Bounded twice: an infinite factor times a dark channel would be no number at all.
    return min(light.emission * min(reflected, vec3f(MAX)), vec3f(MAX));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    let i = invocation.x;
    if i >= arrayLength(&receivers) {
        return;
    }
    var radiance = vec3f(0.0);
    if (blocked[i / 32u] >> (i % 32u) & 1u) == 0u {
        radiance = element(receivers[i]);
    }
    column[i] = Packed(radiance.x, radiance.y, radiance.z);
}
