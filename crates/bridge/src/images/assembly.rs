//! One image on the way.

use std::sync::Arc;

use wire::live::{IMAGE_BYTES_MAX, ImageHead, PIECE_BYTES};

use super::ReceivedImage;

/// What came of a part.
#[derive(Debug)]
pub(super) enum Step {
    /// The image is here.
    Whole(Arc<ReceivedImage>),
    /// Something is missing still, or it was here already.
    Missing,
}

/// What has come of an image.
#[derive(Debug, Default)]
pub(super) enum Assembly {
    /// Nothing.
    #[default]
    Unknown,
    /// Its head, and some pieces.
    Partly { head: Box<ImageHead>, content: Vec<u8>, come: Vec<bool>, n_come: usize },
    /// All of it.
    Whole(Arc<ReceivedImage>),
}

impl Assembly {
    /// Takes its head, for at most `room` bytes; a copy changes nothing. An error is why the image
    /// cannot be taken.
    pub fn begin(&mut self, head: ImageHead, room: usize) -> Result<Step, String> {
        if !matches!(self, Assembly::Unknown) {
            return Ok(Step::Missing);
        }
        let bytes = head.bytes as usize;
        if !(1..=IMAGE_BYTES_MAX).contains(&bytes) {
            return Err(format!("its image has {bytes} bytes; 1 to {IMAGE_BYTES_MAX} are taken"));
        }
        if bytes > room {
            return Err(format!("there is no room for its image of {bytes} bytes on the ground"));
        }
        let n = bytes.div_ceil(PIECE_BYTES);
        let (head, content) = (Box::new(head), vec![0; bytes]);
        *self = Assembly::Partly { head, content, come: vec![false; n], n_come: 0 };
        Ok(Step::Missing)
    }

    /// Takes a piece. One that does not fit is passed over, and missing still.
    pub fn put(&mut self, index: u32, data: &[u8]) -> Step {
        let Assembly::Partly { head, content, come, n_come } = self else { return Step::Missing };
        let index = index as usize;
        let from = index.saturating_mul(PIECE_BYTES);
        let to = from.saturating_add(PIECE_BYTES).min(content.len());
        let Some(place) = content.get_mut(from..to) else { return Step::Missing };
        if come.get(index) != Some(&false) || place.len() != data.len() {
            return Step::Missing;
        }
        place.copy_from_slice(data);
        come[index] = true;
        *n_come += 1;
        if *n_come < come.len() {
            return Step::Missing;
        }
        if blake3::hash(content).to_hex().as_str() != head.hash {
            // Head or pieces were not what was sent: from the beginning.
            *self = Assembly::Unknown;
            return Step::Missing;
        }
        let image =
            ReceivedImage { head: ImageHead::clone(head), png: std::mem::take(content).into() };
        let image = Arc::new(image);
        *self = Assembly::Whole(image.clone());
        Step::Whole(image)
    }

    /// The image, once it is here.
    pub fn whole(&self) -> Option<&Arc<ReceivedImage>> {
        match self {
            Assembly::Whole(image) => Some(image),
            _ => None,
        }
    }

    /// Its head, once that is here.
    pub fn head(&self) -> Option<&ImageHead> {
        match self {
            Assembly::Unknown => None,
            Assembly::Partly { head, .. } => Some(head),
            Assembly::Whole(image) => Some(&image.head),
        }
    }

    /// Bytes that are held for it.
    pub fn bytes(&self) -> usize {
        self.head().map_or(0, |head| head.bytes as usize)
    }

    /// Bytes that have come.
    pub fn come(&self) -> usize {
        match self {
            Assembly::Unknown => 0,
            Assembly::Partly { content, n_come, .. } => (n_come * PIECE_BYTES).min(content.len()),
            Assembly::Whole(image) => image.png.len(),
        }
    }

    /// Share of its bytes that has come.
    pub fn share(&self) -> f64 {
        self.come() as f64 / self.bytes().max(1) as f64
    }

    /// What is missing: the head, and pieces as ranges, at most `most` of them; without a head all.
    pub fn missing(&self, most: usize) -> (bool, Vec<[u32; 2]>) {
        match self {
            Assembly::Unknown => (true, vec![[0, u32::MAX]]),
            Assembly::Whole(_) => (false, Vec::new()),
            Assembly::Partly { come, .. } => {
                let mut ranges: Vec<[u32; 2]> = Vec::new();
                for (index, _) in come.iter().enumerate().filter(|(_, come)| !**come) {
                    let (index, full) = (index as u32, ranges.len() == most);
                    match ranges.last_mut() {
                        Some([_, to]) if *to + 1 == index => *to = index,
                        _ if full => break,
                        _ => ranges.push([index, index]),
                    }
                }
                (false, ranges)
            }
        }
    }
}
