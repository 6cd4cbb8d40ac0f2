//! Why an operation on images, cameras or rigs refused its input. Always bad input, never a bug.

use crate::image::ImageSize;

/// Bad input: which field, which value, what to do instead.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StereoError {
    /// A number that is not finite or lies outside what the field allows.
    #[error("{field} is {value}: give {expected}")]
    OutOfRange {
        /// The field.
        field: String,
        /// What was given.
        value: f64,
        /// What the field takes.
        expected: &'static str,
    },
    /// An image of no or too many pixels.
    #[error(
        "an image of {size} has no or too many pixels: give 16 x 16 to 8192 x 8192, 16 Mpx in all"
    )]
    ImageSize {
        /// The size as given.
        size: ImageSize,
    },
    /// As many values as the size of the image does not ask for.
    #[error("an image of {size} has {expected} values, and {given} were given")]
    PixelCount {
        /// The size as given.
        size: ImageSize,
        /// Values that the size asks for.
        expected: usize,
        /// Values given.
        given: usize,
    },
    /// An image of another size than its calibration.
    #[error(
        "the {what} is {image}, its calibration is for {calibration}: \
         give the calibration of this image size, or resize the camera"
    )]
    SizeMismatch {
        /// Which image.
        what: &'static str,
        /// Size of the image.
        image: ImageSize,
        /// Size that the calibration is for.
        calibration: ImageSize,
    },
    /// The principal point is not in the image, most likely a calibration of another image size.
    #[error(
        "the principal point ({cx:.1}, {cy:.1}) px lies outside the image of {size}: \
         is this the calibration of another image size?"
    )]
    PrincipalPoint {
        /// Column (px).
        cx: f64,
        /// Row (px).
        cy: f64,
        /// Size of the image.
        size: ImageSize,
    },
    /// A rotation that is none.
    #[error(
        "{field} is no rotation: R·Rᵀ is off the identity by {deviation:.2e} and det R is \
         {determinant:.4}; rows and columns must be orthonormal and right-handed"
    )]
    NotARotation {
        /// The field.
        field: String,
        /// Largest entry of R·Rᵀ - 1.
        deviation: f64,
        /// Determinant.
        determinant: f64,
    },
    /// A direction that is not of unit length.
    #[error("{field} has length {length:.6}: give a unit vector")]
    NotAUnitVector {
        /// The field.
        field: String,
        /// Its length.
        length: f64,
    },
    /// Vectors of a CAHV model from which no pixel has a ray.
    #[error("A, H and V lie in one plane: no pixel has a ray; check the model")]
    FlatModel,
    /// A camera so far from its origin, with such a lens, that its pixels cannot be told apart.
    #[error(
        "the camera is {distance_m:.0} m from the origin of its frame, where a point 1 m before it is off by {error_px:.1e} \
         px in its image for want of digits: give its place from a nearer origin, or check focal length and lens"
    )]
    CameraTooFar {
        /// Distance of its center from the origin (m).
        distance_m: f64,
        /// What rounding a point does in the image (px).
        error_px: f64,
    },
    /// A calibration file that misses a value.
    #[error("the {format} calibration has no {field}: {hint}")]
    Missing {
        /// Kind of file.
        format: &'static str,
        /// The field.
        field: String,
        /// What would do.
        hint: &'static str,
    },
    /// A value that cannot be read.
    #[error("line {line} of the {format} calibration: {field} is {value:?}: give {expected}")]
    Unreadable {
        /// Kind of file.
        format: &'static str,
        /// Line, from 1.
        line: usize,
        /// The field.
        field: String,
        /// What stands there.
        value: String,
        /// What the field takes.
        expected: &'static str,
    },
    /// A model that is known and not supported.
    #[error("the {format} calibration has {what}, which is not supported: {hint}")]
    Unsupported {
        /// Kind of file.
        format: &'static str,
        /// What it has.
        what: String,
        /// The way out.
        hint: &'static str,
    },
    /// A file too large to be a calibration.
    #[error("a calibration of {n_bytes} bytes is too large: give at most 1 MB of text")]
    TextTooLarge {
        /// Size as given.
        n_bytes: usize,
    },
    /// Two cameras at one place.
    #[error("the baseline is {baseline_m:e} m: the cameras of a pair must be apart")]
    NoBaseline {
        /// Distance of the centers (m).
        baseline_m: f64,
    },
    /// The right camera stands left of the left one.
    #[error("the right camera is to the left of the left one: left and right are swapped")]
    Swapped,
    /// Cameras that do not look the same way, or stand above or behind each other.
    #[error("the pair cannot be rectified: {what}")]
    NotAPair {
        /// What is wrong.
        what: &'static str,
    },
    /// Bytes that are no PNG that is taken, or an image that cannot become one.
    #[error("the PNG cannot be used: {what}")]
    Png {
        /// What is wrong.
        what: String,
    },
    /// A table of `robot.toml` that does not parse.
    #[error("the camera pairs of robot.toml do not parse: {message}")]
    Toml {
        /// What the parser says.
        message: String,
    },
    /// A camera pair that names what is not there.
    #[error("camera pair {pair:?}: {what}")]
    Pair {
        /// The pair's name.
        pair: String,
        /// What is wrong and the way out.
        what: String,
    },
    /// The caller asked to stop.
    #[error("the work was stopped")]
    Stopped,
}

impl StereoError {
    /// `value` if it is finite and within `range`.
    pub(crate) fn check(
        field: &str,
        value: f64,
        range: [f64; 2],
        expected: &'static str,
    ) -> Result<f64, StereoError> {
        if value.is_finite() && range[0] <= value && value <= range[1] {
            Ok(value)
        } else {
            Err(StereoError::OutOfRange { field: field.to_owned(), value, expected })
        }
    }
}
