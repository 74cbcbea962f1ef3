//! Uses nodes as plain functions: `cargo run --release --example 2_nodes_without_a_graph`.
//!
//! Renders the pavilion lit by its sky with all lights, once by the brute-force sum and once by
//! row-column sampling, and prints how far the second is from the first.

use lightloom::nodes::node::{All, Ctx, Error, Item, Node};
use lightloom::nodes::*;

fn main() -> Result<(), Error> {
    let ctx = Ctx::default();
    let scene = Item::from(Pavilion { detail: 0.3, ..Pavilion::default() }.run((), &ctx)?);
    let geometry = Item::from(Geometry::default().run(GeometryIn { scene: scene.clone() }, &ctx)?);
    let materials =
        Item::from(Materials::default().run(MaterialsIn { scene: scene.clone() }, &ctx)?);
    let poses =
        Item::from(Poses::default().run(PosesIn { scene: scene.clone(), time: None }, &ctx)?);
    let camera = Item::from(Camera::default().run(CameraIn { scene, time: None }, &ctx)?);
    let environment = Item::from(Sky::default().run((), &ctx)?);
    let sky = EnvironmentLights { count: 1024, ..EnvironmentLights::default() };
    let lights =
        Item::from(sky.run(EnvironmentLightsIn { environment: environment.clone() }, &ctx)?);

    let seen = DeepFramebuffer { size: [96, 54], ..DeepFramebuffer::default() };
    let input = DeepFramebufferIn {
        geometry: geometry.clone(),
        materials: materials.clone(),
        poses: poses.clone(),
        camera,
        environment: Some(environment),
    };
    let framebuffer = Item::from(seen.run(input, &ctx)?);

    let input = ReferenceIn {
        framebuffer: framebuffer.clone(),
        lights: Some(lights.clone()),
        geometry: geometry.clone(),
        materials: materials.clone(),
        poses: poses.clone(),
    };
    let truth = Item::from(Reference {}.run(input, &ctx)?);

    let input = RowsIn {
        framebuffer: framebuffer.clone(),
        lights: lights.clone(),
        geometry: geometry.clone(),
        materials: materials.clone(),
        poses: poses.clone(),
    };
    let rows = Item::from(Rows::default().run(input, &ctx)?);
    let one = |item: &Item<data::Rows>| -> All<data::Rows> { vec![item.clone()].into() };
    for count in [10, 50, 250] {
        let columns = ColumnClusters { count, ..ColumnClusters::default() };
        let clusters = Item::from(columns.run(ColumnClustersIn { rows: one(&rows) }, &ctx)?);
        let choice = Representatives { count, ..Representatives::default() };
        let representatives = choice.run(RepresentativesIn { clusters, rows: one(&rows) }, &ctx)?;
        let input = ReconstructIn {
            representatives: representatives.into(),
            framebuffer: vec![framebuffer.clone()].into(),
            lights: vec![lights.clone()].into(),
            geometry: geometry.clone(),
            materials: materials.clone(),
            poses: vec![poses.clone()].into(),
            maps: None,
        };
        let image = Reconstruct {}.run(input, &ctx)?.items.remove(0);
        let image = vec![Item::from(image)].into();
        let error = Compare::default()
            .run(CompareIn { image, reference: vec![truth.clone()].into() }, &ctx)?;
        println!("{count:4} of 1024 columns: relative L2 error {:.4}", error.relative_l2[0]);
    }
    Ok(())
}
