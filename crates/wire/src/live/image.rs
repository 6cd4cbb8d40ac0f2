//! Images: what is asked of the rover's cameras, what comes down of them, and what is told of them.
//!
//! A *capture* is what one `image` command takes, named by that command. Each image comes down as a
//! head and pieces of [`PIECE_BYTES`]; `End` is behind the last one. The ground asks for what is missing
//! then, and lets the capture go once it has all.

use std::collections::BTreeMap;
use std::fmt;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use utoipa::ToSchema;

use crate::scene::RoverState;
use crate::time::Timestamp;

/// Bytes of a piece; the last one of an image may be shorter.
pub const PIECE_BYTES: usize = 4000;
/// Most bytes of one image.
pub const IMAGE_BYTES_MAX: usize = 4 << 20;
/// Most ranges of pieces that one request to send again names.
pub const RANGES_MAX: usize = 256;
/// Range of the bits of gray.
pub const DEPTH_BITS: [u8; 2] = [4, 8];
/// Range of the rate of an order (bit/s).
pub const IMAGE_RATE_BPS: [f64; 2] = [100.0, 1e9];

/// Which images the rover takes, all at one instant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageOrder {
    /// Names of pairs, 1 to 16, each once.
    pub pairs: Vec<String>,
    /// Size of the images as a share of the pair's own, 0.25 to 1; 0.5 where absent.
    #[serde(default = "half")]
    pub scale: f64,
    /// Size of the images of single pairs, by name, where other than `scale`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub scales: BTreeMap<String, f64>,
    /// Bits of gray that are kept, 4 to 8; 8, which loses nothing, where absent. With 6 an image has
    /// about half the bytes: what is lost is mostly noise.
    #[serde(default = "eight")]
    pub depth_bits: u8,
    /// Rate at which the rover hands pieces to its transmitter (bit/s), 100 to 10^9. Where absent in a
    /// request, what the link has beside telemetry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_bps: Option<f64>,
    /// What the cameras of a simulated rover do; other rovers ignore it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulated: Option<SimulatedCameras>,
}

fn half() -> f64 {
    0.5
}

fn eight() -> u8 {
    8
}

fn yes() -> bool {
    true
}

/// What simulated cameras do to their images, each switchable and seeded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulatedCameras {
    /// Seed of the noise, 0 to 2^53.
    #[serde(default)]
    pub seed: u64,
    /// Point spread, vignetting and noise.
    #[serde(default = "yes")]
    pub noise: bool,
    /// Hard shadows of the sun.
    #[serde(default = "yes")]
    pub shadows: bool,
    /// Errors of the calibration as a multiple of the usual ones, 0 (none) to 10.
    #[serde(default)]
    pub calibration_errors: f64,
    /// Seed of these, 0 to 2^53: the same rover has the same errors each time.
    #[serde(default)]
    pub calibration_seed: u64,
}

impl Default for SimulatedCameras {
    fn default() -> SimulatedCameras {
        SimulatedCameras {
            seed: 0,
            noise: true,
            shadows: true,
            calibration_errors: 0.0,
            calibration_seed: 0,
        }
    }
}

/// Which camera of a pair.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // each is its name
pub enum Side {
    Left,
    Right,
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Side::Left => "left",
            Side::Right => "right",
        })
    }
}

/// Which image.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageName {
    /// The capture: identity of its command.
    pub capture: String,
    /// The pair.
    pub pair: String,
    /// The camera.
    pub side: Side,
}

/// What comes down of images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "part", rename_all = "snake_case", deny_unknown_fields)]
pub enum ImageDown {
    /// What an image is: before its pieces.
    Head(ImageHead),
    /// A piece of an image.
    Piece {
        /// The image.
        image: ImageName,
        /// Its place: it begins at this many times 4000 bytes.
        index: u32,
        /// The bytes, in base64.
        #[schema(value_type = String)]
        data: PieceData,
    },
    /// All of a capture that was asked for has been sent.
    End {
        /// The capture.
        capture: String,
        /// Pairs that could not be taken.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        failed: Vec<FailedPair>,
    },
    /// The rover keeps nothing of that capture.
    Gone {
        /// The capture.
        capture: String,
    },
}

/// A pair that there are no images of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FailedPair {
    /// Its name.
    pub pair: String,
    /// Why.
    pub why: String,
}

/// What an image is, when it was taken, and where the rover said that it was then.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageHead {
    /// The image.
    pub image: ImageName,
    /// When it was taken, on board.
    pub time: Timestamp,
    /// Pose and joint angles as the rover reports them of that moment.
    pub state: RoverState,
    /// Columns and rows (px).
    pub size_px: [u32; 2],
    /// Bytes of the PNG (8 bits of gray), at most 4 MiB.
    pub bytes: u32,
    /// BLAKE3 of the PNG, in hexadecimal.
    pub hash: String,
}

/// What the ground asks of images that were taken. Not a command: nothing moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub enum ImageUp {
    /// Send these again.
    Repeat {
        /// The capture.
        capture: String,
        /// What is missing, 256 ranges at most in all.
        missing: Vec<MissingParts>,
    },
    /// Stop, and forget the images of a capture.
    LetGo {
        /// The capture.
        capture: String,
    },
}

/// Parts of an image that have not come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MissingParts {
    /// The pair.
    pub pair: String,
    /// The camera.
    pub side: Side,
    /// The head.
    #[serde(default)]
    pub head: bool,
    /// Pieces, from and to with both ends.
    #[serde(default)]
    pub pieces: Vec<[u32; 2]>,
}

/// An image that has come whole: told, and logged beside the image itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageReceived {
    /// What it is.
    pub head: ImageHead,
    /// The channel of the flight log that holds it.
    pub topic: String,
}

/// Bytes of a piece: base64 in text.
#[derive(Clone, PartialEq, Eq)]
pub struct PieceData(pub Vec<u8>);

impl fmt::Debug for PieceData {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.0.len())
    }
}

impl Serialize for PieceData {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&STANDARD.encode(&self.0))
    }
}

impl<'de> Deserialize<'de> for PieceData {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<PieceData, D::Error> {
        use serde::de::Error;
        let text = std::borrow::Cow::<str>::deserialize(deserializer)?;
        // Decoded it has three quarters of the length.
        if text.len() > 2 * PIECE_BYTES {
            return Err(D::Error::custom(format_args!("a piece has at most {PIECE_BYTES} bytes")));
        }
        STANDARD.decode(text.as_bytes()).map(PieceData).map_err(D::Error::custom)
    }
}
