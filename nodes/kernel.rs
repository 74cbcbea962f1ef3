//! What computes: everything that two nodes need, and every algorithm that is a subject of its own.

pub mod animation;
pub mod brdf;
pub mod checkpoint;
pub mod closed;
pub mod clustering;
pub mod cover;
pub mod density;
pub mod element;
pub mod gltf;
pub mod history;
pub mod lanes;
pub mod latlong;
pub mod light_list;
pub mod light_tensor;
pub mod mapper;
pub mod meshes;
pub mod metrics;
pub mod morton;
pub mod neighbours;
pub mod nine_vectors;
pub mod pages;
pub mod pbgi;
pub mod photon_tracing;
pub mod posing;
pub mod primary;
pub mod radiance_file;
pub mod receivers;
pub mod ridge;
pub mod scaled_sums;
pub mod shapes;
pub mod sky;
pub mod stage;
pub mod surface_sampling;
pub mod texture;
pub mod tile;
pub mod tone;
pub mod visibility;

#[cfg(test)]
pub mod fixtures;
