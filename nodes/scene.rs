//! Scenes from glTF 2.0 files.

use crate::data;
use crate::kernel::gltf;
use crate::node::{Ctx, Error, File, Node, Sizes};
use std::path::PathBuf;

crate::params! {
    /// Reads a scene from a glTF 2.0 file, `.gltf` or `.glb`: its default scene with meshes, instances,
    /// skins, morph targets, one animation, materials with their textures, cameras and lights.
    pub struct Scene {
        /// The glTF or GLB file; buffers and images are found relative to it.
        file: File;
        /// Which of the file's animations moves the scene, counted from 0. A file without animations
        /// stands still with clip 0.
        clip: u32 = 0;
    }
}

impl Node for Scene {
    const KIND: &'static str = "Scene";
    const VERSION: u32 = 1;
    type In = ();
    type Out = data::Scene;

    fn reads(&self) -> Vec<PathBuf> {
        gltf::references(&self.file.0)
    }

    /// Geometry unpacks to about twice its bytes in the files, a JPEG to about ten times.
    fn memory(&self, _: &Sizes) -> u64 {
        let bytes = |path: &PathBuf| std::fs::metadata(path).map_or(0, |file| file.len());
        self.reads().iter().map(bytes).sum::<u64>().saturating_mul(10)
    }

    fn run(&self, (): (), ctx: &Ctx) -> Result<data::Scene, Error> {
        gltf::import(&self.file.0, self.clip, ctx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::Params;

    #[test]
    fn reads_every_referenced_file_even_a_missing_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        let json = r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"a%20b.bin"}],
            "images":[{"uri":"gone.png"},{"uri":"data:image/png;base64,"},{"uri":"a b.bin"}]}"#;
        std::fs::write(&path, json).unwrap();
        let mut scene = Scene::default();
        scene.set("file", &format!("{:?}", path.display().to_string())).unwrap();
        assert_eq!(
            scene.reads(),
            [path, folder.path().join("a b.bin"), folder.path().join("gone.png")]
        );
    }

    #[test]
    fn a_missing_file_and_a_missing_buffer_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        let scene = Scene { file: File(path.clone()), clip: 0 };
        assert_eq!(scene.reads(), std::slice::from_ref(&path));
        assert!(scene.run((), &Ctx::default()).unwrap_err().to_string().contains("a.gltf"));
        let json = r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"gone.bin"}]}"#;
        std::fs::write(&path, json).unwrap();
        let text = scene.run((), &Ctx::default()).unwrap_err().to_string();
        assert!(
            text.contains("a.gltf") && text.contains("buffers[0]") && text.contains("gone.bin"),
            "{text}"
        );
    }

    #[test]
    fn a_file_without_triangles_is_a_scene() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        std::fs::write(&path, r#"{"asset":{"version":"2.0"}}"#).unwrap();
        let scene = Scene { file: File(path.clone()), clip: 0 }.run((), &Ctx::default()).unwrap();
        assert_eq!((scene.triangle.len(), scene.base_colour.len()), (0, 1));
        let text =
            Scene { file: File(path), clip: 1 }.run((), &Ctx::default()).unwrap_err().to_string();
        assert!(text.contains("clip 1"), "{text}");
    }
}
