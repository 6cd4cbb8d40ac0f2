//! Images of the rover with their calibration and place, as messages of the Foxglove schemas.

use bytes::Bytes;
use nalgebra::Isometry3;
use prost::Message;
use rover::{Posture, Robot};
use stereo::camera::Camera;
use stereo::rig::Rig;
use stereo::{ImageSize, StereoError};

use super::schema::{CameraCalibration, CompressedImage, FrameTransform};
use super::{quaternion, timestamp, vector};
use crate::check::{At, RequestError};
use crate::convert;
use crate::live::{ImageHead, Side};

/// Name of the schema of images.
pub const IMAGE_SCHEMA: &str = "foxglove.CompressedImage";
/// Name of the schema of calibrations.
pub const CALIBRATION_SCHEMA: &str = "foxglove.CameraCalibration";
/// Name of the schema of the places of cameras.
pub const PLACE_SCHEMA: &str = "foxglove.FrameTransform";

/// The topics of one camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraTopics {
    /// `/camera/nav1/left/image`.
    pub image: String,
    /// `/camera/nav1/left/calibration`.
    pub calibration: String,
    /// `/camera/nav1/left/tf`: where the camera was in `world`.
    pub place: String,
}

impl CameraTopics {
    /// The topics of a camera of a pair.
    pub fn new(pair: &str, side: Side) -> CameraTopics {
        let topic = |what: &str| format!("/camera/{pair}/{side}/{what}");
        CameraTopics {
            image: topic("image"),
            calibration: topic("calibration"),
            place: topic("tf"),
        }
    }

    /// The topics with the names of their schemas.
    pub fn with_schemas(self) -> [(String, &'static str); 3] {
        let CameraTopics { image, calibration, place } = self;
        [(image, IMAGE_SCHEMA), (calibration, CALIBRATION_SCHEMA), (place, PLACE_SCHEMA)]
    }
}

/// An image as viewers take it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraMessages {
    /// `foxglove.CompressedImage`, encoded.
    pub image: Bytes,
    /// `foxglove.CameraCalibration`, encoded; none for cameras that are not pinholes.
    pub calibration: Option<Bytes>,
    /// `foxglove.FrameTransform`, encoded.
    pub place: Bytes,
}

/// The messages of an image, its camera being the rig's where the rover said that it was.
///
/// # Errors
/// Where the head is not one of this robot and rig, with the field that tells.
pub fn camera_messages(
    robot: &Robot,
    rig: &Rig,
    head: &ImageHead,
    png: &[u8],
) -> Result<CameraMessages, RequestError> {
    let at = At::root("image");
    let name = &head.image;
    let pair = rig.pair(&name.pair).ok_or_else(|| {
        let text = format_args!("names the pair {:?}, which the robot has not", name.pair);
        RequestError::at("camera_unknown", &at.field("pair"), text)
    })?;
    let refuse = |error: StereoError| {
        RequestError::at("out_of_range", &at.field("size_px"), format_args!("is refused: {error}"))
    };
    let [width, height] = head.size_px.map(|n| n as usize);
    let pair = ImageSize::new(width, height).and_then(|size| pair.resized(size)).map_err(refuse)?;
    let configuration = convert::configuration(&at.field("state"), robot, &head.state)?;
    let cameras = pair.cameras(&Posture::new(robot, &configuration));
    let camera = &cameras[usize::from(name.side == Side::Right)];
    let (time, frame_id) = (Some(timestamp(head.time)), format!("{}_{}", name.pair, name.side));
    let image = CompressedImage {
        timestamp: time,
        data: png.to_vec(),
        format: "png".into(),
        frame_id: frame_id.clone(),
    };
    let calibration = calibration(camera).map(|calibration| {
        let calibration =
            CameraCalibration { timestamp: time, frame_id: frame_id.clone(), ..calibration };
        calibration.encode_to_vec().into()
    });
    let world_from_camera = Isometry3::from_parts(camera.center().into(), camera.axes());
    let place = FrameTransform {
        timestamp: time,
        parent_frame_id: "world".into(),
        child_frame_id: frame_id,
        translation: Some(vector(&world_from_camera.translation.vector)),
        rotation: Some(quaternion(&world_from_camera.rotation)),
    };
    Ok(CameraMessages {
        image: image.encode_to_vec().into(),
        calibration,
        place: place.encode_to_vec().into(),
    })
}

/// The calibration of a pinhole camera, without time and frame.
fn calibration(camera: &Camera) -> Option<CameraCalibration> {
    let Camera::Pinhole(pinhole) = camera else { return None };
    let ([fx, fy], [cx, cy]) = (pinhole.focal(), pinhole.principal());
    let brown = pinhole.distortion();
    let size = pinhole.size();
    Some(CameraCalibration {
        width: size.width as u32,
        height: size.height as u32,
        distortion_model: "plumb_bob".into(),
        d: vec![brown.k1, brown.k2, brown.p1, brown.p2, brown.k3],
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraCalibration::default()
    })
}

/// The PNG of an encoded `foxglove.CompressedImage`.
pub fn png_of(message: &[u8]) -> Option<Vec<u8>> {
    let image = CompressedImage::decode(message).ok()?;
    (image.format == "png").then_some(image.data)
}
