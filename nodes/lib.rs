//! The nodes of Lightloom and the library beneath them.
//!
//! Down the page: [`node`] (the contract) <- [`data`] (what flows) <- [`kernel`] (what computes) <-
//! the nodes, one a file. Nodes never import each other.

pub mod data;
pub mod kernel;
pub mod node;

use node::Node;

/// Visits the type of every node.
pub trait Visit {
    /// Called once for each node type.
    fn node<N: Node>(&mut self);
}

/// Lists the nodes: file, type. Adding a node adds its file and its line here.
macro_rules! nodes {
    ($($file:ident $node:ident;)*) => {
        $(mod $file;)*
        $(pub use $file::*;)*

        /// Shows every node type to `visit`, in the order of the list.
        pub fn each(visit: &mut impl Visit) {
            $(visit.node::<$file::$node>();)*
        }
    };
}

nodes! {
    ambient_occlusion AmbientOcclusion;
    anti_alias AntiAlias;
    apng Apng;
    camera Camera;
    clusters Clusters;
    color_video_vdp ColorVideoVdp;
    column_clusters ColumnClusters;
    compare Compare;
    deep_framebuffer DeepFramebuffer;
    difference Difference;
    emissive_lights EmissiveLights;
    environment_lights EnvironmentLights;
    environment_map EnvironmentMap;
    exr Exr;
    flip Flip;
    flip_map FlipMap;
    frames Frames;
    gather_lights GatherLights;
    gather_samples GatherSamples;
    geometry Geometry;
    ground Ground;
    image_file ImageFile;
    lut Lut;
    materials Materials;
    meadow Meadow;
    merge_lights MergeLights;
    orbit_camera OrbitCamera;
    pavilion Pavilion;
    pbgi_gather PbgiGather;
    pbgi_memory PbgiMemory;
    pbgi_tree PbgiTree;
    perceptual_differences PerceptualDifferences;
    photon_lights PhotonLights;
    photons Photons;
    pixel_maps PixelMaps;
    png Png;
    poses Poses;
    punctual_lights PunctualLights;
    quantization_error QuantizationError;
    reconstruct Reconstruct;
    reference Reference;
    representatives Representatives;
    rows Rows;
    scene Scene;
    shade_surfels ShadeSurfels;
    sky Sky;
    ssim Ssim;
    still Still;
    sum Sum;
    sun_lights SunLights;
    surfels Surfels;
}
