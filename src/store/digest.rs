//! Digests in the store: the key of an action, and text that carries its own check.

use std::str::from_utf8;

use lightloom_nodes::node::Digest;

/// The key of the action whose canonical description is `manifest`: BLAKE3 in key derivation mode with the context
/// `lightloom action v1`, so that no key can equal the digest of a blob.
pub fn key_of(manifest: &str) -> Digest {
    Digest(blake3::derive_key("lightloom action v1", manifest.as_bytes()))
}

/// `text` with its digest in a last line, which RON reads as a comment. A torn or altered file fails [`unseal`].
pub(super) fn seal(text: &str) -> String {
    format!("{text}\n// {}\n", Digest::of(text.as_bytes()))
}

/// The text given to [`seal`], or None when anything in it is not as it was written.
pub(super) fn unseal(sealed: &[u8]) -> Option<&str> {
    let (text, check) = from_utf8(sealed).ok()?.strip_suffix('\n')?.rsplit_once("\n// ")?;
    (check.parse::<Digest>().ok()? == Digest::of(text.as_bytes())).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values from an implementation of BLAKE3 written anew from its specification.
    #[test]
    fn the_key_is_known() {
        assert_eq!(
            key_of("").to_string(),
            "9eaa94b1c69c634a76eb63d4a586f139c5c6388d721bcf9ea8c87903da0d077e"
        );
        assert_eq!(
            key_of("Clusters 1\nstart: 100\n").to_string(),
            "3d9acb8d610c17c890e4afc372d878364f72d254ac8d6048e0260afe127595c1"
        );
    }

    #[test]
    fn a_key_is_never_the_digest_of_the_same_text() {
        assert_ne!(key_of("a"), Digest::of(b"a"));
    }

    #[test]
    fn every_torn_or_flipped_text_is_noticed() {
        let sealed = seal("Record(\n    // \u{e9}\n    bytes: 12,\n)").into_bytes();
        assert_eq!(unseal(&sealed), Some("Record(\n    // \u{e9}\n    bytes: 12,\n)"));
        for end in 0..sealed.len() {
            assert_eq!(unseal(&sealed[..end]), None, "cut at {end}");
        }
        for at in 0..sealed.len() {
            let mut flipped = sealed.clone();
            flipped[at] ^= 1;
            assert_eq!(unseal(&flipped), None, "flipped at {at}");
        }
    }
}
