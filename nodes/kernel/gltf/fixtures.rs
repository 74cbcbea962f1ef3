//! Tiny files for tests.

use super::container::Container;
use crate::data::Scene;
use crate::node::{Ctx, Error};
use serde_json::{Value, json};
use std::path::Path;

const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// A data URI of the bytes.
pub(super) fn data_uri(bytes: &[u8]) -> String {
    let mut text = String::from("data:application/octet-stream;base64,");
    for group in bytes.chunks(3) {
        let bits = group
            .iter()
            .chain(&[0; 2])
            .take(3)
            .fold(0_usize, |bits, b| bits << 8 | usize::from(*b));
        for i in 0..4 {
            let digit = if i <= group.len() { DIGITS[bits >> (18 - 6 * i) & 63] } else { b'=' };
            text.push(char::from(digit));
        }
    }
    text
}

/// A buffer, its views and accessors, under construction.
#[derive(Default)]
pub(super) struct Pack {
    bytes: Vec<u8>,
    views: Vec<Value>,
    pub(super) accessors: Vec<Value>,
}

impl Pack {
    /// Adds a view of raw bytes and gives its number.
    pub(super) fn view(&mut self, bytes: &[u8]) -> usize {
        self.views.push(
            json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() }),
        );
        self.bytes.extend_from_slice(bytes);
        self.views.len() - 1
    }

    /// Adds an accessor of floats and gives its number.
    pub(super) fn floats(&mut self, kind: &str, width: usize, values: &[f32]) -> usize {
        let view = self.view(bytemuck::cast_slice(values));
        let count = values.len() / width;
        self.accessors.push(
            json!({ "bufferView": view, "componentType": 5126, "count": count, "type": kind }),
        );
        self.accessors.len() - 1
    }

    /// Adds an accessor of indices and gives its number.
    pub(super) fn indices(&mut self, values: &[u16]) -> usize {
        let view = self.view(bytemuck::cast_slice(values));
        self.accessors
            .push(json!({ "bufferView": view, "componentType": 5123, "count": values.len(), "type": "SCALAR" }));
        self.accessors.len() - 1
    }

    /// The file: `rest` with the asset, the buffer and its lists.
    pub(super) fn file(self, mut rest: Value) -> Value {
        rest["asset"] = json!({ "version": "2.0" });
        rest["buffers"] = json!([{ "byteLength": self.bytes.len(), "uri": data_uri(&self.bytes) }]);
        rest["bufferViews"] = self.views.into();
        rest["accessors"] = self.accessors.into();
        rest
    }
}

/// A unit right triangle in the xy plane and what `rest` adds.
pub(super) fn triangle(pack: &mut Pack) -> Value {
    let position = pack.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    json!({ "nodes": [{ "mesh": 0 }], "meshes": [{ "primitives": [{ "attributes": { "POSITION": position } }] }] })
}

/// Imports a file with its notes.
pub(super) fn import(file: &Value) -> (Result<Scene, Error>, Vec<String>) {
    let ctx = Ctx::default();
    let container = Container { json: file.as_object().cloned().unwrap_or_default(), binary: None };
    (super::assemble(container, Path::new("nowhere"), 0, &ctx), ctx.notes())
}

/// The scene of a good file.
pub(super) fn scene(file: &Value) -> Scene {
    import(file).0.unwrap_or_else(|e| panic!("{e}\n{file}"))
}

/// The error of a bad file.
pub(super) fn error(file: &Value) -> String {
    import(file).0.expect_err("a bad file").to_string()
}
