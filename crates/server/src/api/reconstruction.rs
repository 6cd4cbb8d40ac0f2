//! The stereo pairs of the live rover, and the maps made of them.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use geometry::Grid;
use nalgebra::Point2;
use rover::Posture;
use stereo::StereoError;
use stereo::coverage::{Coverage, coverage};
use stereo::rig::CameraPair;
use terrain::ElevationMap;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use wire::check::{self, At, RequestError};
use wire::live::{DEPTH_BITS, JobReport};
use wire::reconstruction::{
    CameraAnswer, CamerasAnswer, CoverageAnswer, CoverageOfPair, CoverageRequest, ImageCost,
    RESOLUTION_M, ReconstructionAnswer, ReconstructionRequest, RestoreRequest, SCALE,
};
use wire::resources::ErrorBody;

use crate::app::AppState;
use crate::body::{Body, Operator, Path};
use crate::error::ApiError;
use crate::imaging;
use crate::reconstruction::{self, hidden, restore};
use crate::stop::Stop;

/// Time allowed for a coverage (s): less than for any answer.
const COVERAGE_DEADLINE_S: f64 = 20.0;
/// Distance of nodes of a coverage where the request names none (m).
const COVERAGE_RESOLUTION_M: f64 = 0.1;

pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(cameras))
        .routes(routes!(camera_coverage))
        .routes(routes!(start_reconstruction))
        .routes(routes!(reconstruction_answer))
        .routes(routes!(restore_map))
}

/// Rate of telemetry (bit/s), if there is a limit.
fn downlink_bps(app: &AppState) -> Option<f64> {
    app.live.locked().0.link().config.down.and_then(|down| down.rate_bps)
}

fn seconds(bytes: usize, rate_bps: Option<f64>) -> Option<f64> {
    rate_bps.map(|rate| 8.0 * bytes as f64 / rate)
}

/// The stereo pairs of the live rover, with what their images weigh.
#[utoipa::path(
    get, path = "/rover/cameras", tag = "rover",
    responses((status = 200, body = CamerasAnswer), (status = 422, body = ErrorBody))
)]
async fn cameras(State(app): State<AppState>) -> Result<Json<CamerasAnswer>, ApiError> {
    let rig = app.live.rig().clone();
    let rate = downlink_bps(&app);
    let robot = app.live.robot();
    let camera = |pair: &CameraPair| {
        let size = pair.left.size();
        let kind = match pair.name.get(..3) {
            Some("nav") => "navcam",
            Some("haz") => "hazcam",
            _ => "other",
        };
        let middle = nalgebra::center(&pair.left.center(), &pair.right.center());
        let looks = pair.left.axes() * nalgebra::Vector3::z();
        CameraAnswer {
            name: pair.name.clone(),
            kind: kind.into(),
            link: robot.links()[pair.link.0].name.clone(),
            size_px: [size.width, size.height],
            baseline_m: (pair.right.center() - pair.left.center()).norm(),
            position_m: middle.into(),
            azimuth_rad: looks.y.atan2(looks.x),
            elevation_rad: looks.z.clamp(-1.0, 1.0).asin(),
            field_of_view_rad: 2.0 * (0.5 * size.width as f64 / pair.left.focal()[0]).atan(),
            range_m: pair.range,
            raw_bytes: pair.raw_bytes(),
            downlink_s: seconds(pair.raw_bytes(), rate),
        }
    };
    let cameras = rig.pairs().iter().map(camera).collect();
    Ok(Json(CamerasAnswer { cameras, downlink_bps: rate }))
}

/// What pairs would see of the map in use, past the robot as it stands, before any image is taken. Shadows
/// and texture are only known afterward.
#[utoipa::path(
    post, path = "/rover/cameras/coverage", tag = "rover", request_body = CoverageRequest,
    responses(
        (status = 200, body = CoverageAnswer), (status = 409, body = ErrorBody),
        (status = 422, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn camera_coverage(
    State(app): State<AppState>,
    Body(request): Body<CoverageRequest>,
) -> Result<Json<CoverageAnswer>, ApiError> {
    let pairs = reconstruction::chosen(app.live.rig(), &request.cameras)?;
    let resolution_m = request.resolution_m.unwrap_or(COVERAGE_RESOLUTION_M);
    check::within(&At::root("resolution_m"), resolution_m, RESOLUTION_M, " m")?;
    let scale = check::within(&At::root("scale"), request.scale.unwrap_or(0.5), SCALE, "")?;
    let depth_bits = request.depth_bits.unwrap_or(8);
    let [least, most] = DEPTH_BITS.map(f64::from);
    check::within(&At::root("depth_bits"), depth_bits.into(), [least, most], " bits")?;
    let sized: Vec<(&CameraPair, f64)> = pairs.iter().map(|pair| (pair, scale)).collect();
    let cost = imaging::cost(&sized, depth_bits, &app.live.locked().0.link());
    let (robot, configuration) = (app.live.robot().clone(), app.live.configuration()?);
    let posture = Posture::new(&robot, &configuration);
    let version = app.store.current();
    let wheels = reconstruction::standing(&app.live.latest()?.frame);
    let grid = grid_about(&version.map, &posture, &pairs, resolution_m)?;
    let stop = Stop::after(Some(COVERAGE_DEADLINE_S))?;
    let asked = stop.clone();
    let seen = version.clone();
    let work = move || {
        // Whether a hole would be closed is to be told before: its ground is guessed.
        let map = hidden::guessed(&seen.map, &wheels);
        let looked: Vec<&CameraPair> = pairs.iter().collect();
        let stop = || asked.asked();
        let covered = coverage(&looked, &robot, &posture, &map, &grid, &stop)?;
        let (told, mask) = hidden::hidden(&covered, &pairs, &robot, &posture, &map, &stop)?;
        Ok((covered, told, mask))
    };
    let (covered, told, mask) =
        app.gate.run(&stop, work).await?.map_err(|error: StereoError| match error {
            StereoError::Stopped => {
                let message =
                    "the coverage took too long: give a coarser resolution_m or fewer pairs";
                ApiError::new("deadline", message)
            }
            other => ApiError::new("out_of_range", other.to_string()),
        })?;
    let rate = downlink_bps(&app);
    let answer = coverage_answer(&covered, version.info.version.clone(), rate);
    Ok(Json(CoverageAnswer { hidden: told, hidden_base64: STANDARD.encode(mask), cost, ..answer }))
}

/// The part of the map that the pairs may reach from where they are.
fn grid_about(
    map: &ElevationMap,
    posture: &Posture,
    pairs: &[CameraPair],
    resolution: f64,
) -> Result<Grid, RequestError> {
    let (low, high) = (map.grid().origin, map.grid().far_corner());
    let mut ends = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for pair in pairs {
        let center = pair.cameras(posture)[0].center();
        // The range is a depth; a point at the edge of the image is farther.
        let reach = 1.5 * pair.range[1];
        for axis in 0..2 {
            ends[axis] = ends[axis].min(center[axis] - reach).max(low[axis]);
            ends[2 + axis] = ends[2 + axis].max(center[axis] + reach).min(high[axis]);
        }
    }
    let count = |from: f64, to: f64| ((to - from) / resolution + 1e-9).floor() + 1.0;
    let (nx, ny) = (count(ends[0], ends[2]), count(ends[1], ends[3]));
    if !(nx >= 1.0 && ny >= 1.0) {
        let message = "the rover is reported to be outside the map: no pair would see any of it";
        return Err(RequestError::new("nothing_seen", message));
    }
    Ok(Grid { origin: Point2::new(ends[0], ends[1]), resolution, nx: nx as usize, ny: ny as usize })
}

fn coverage_answer(
    covered: &Coverage,
    terrain_version: String,
    rate: Option<f64>,
) -> CoverageAnswer {
    let grid = covered.grid;
    let share = |n: usize| n as f64 / grid.len().max(1) as f64;
    let mut mask = vec![0_u16; grid.len()];
    let mut cameras = Vec::with_capacity(covered.pairs.len());
    for (bit, pair) in covered.pairs.iter().enumerate() {
        let mut n_seen = 0;
        for (cell, value) in mask.iter_mut().zip(pair.ground_resolution.values()) {
            if !value.is_nan() {
                *cell |= 1 << bit;
                n_seen += 1;
            }
        }
        cameras.push(CoverageOfPair {
            name: pair.name.clone(),
            bit: bit as u8,
            area_m2: pair.area,
            seen_share: share(n_seen),
            raw_bytes: pair.raw_bytes,
        });
    }
    let bytes: Vec<u8> = mask.iter().flat_map(|cell| cell.to_le_bytes()).collect();
    let raw_bytes = covered.pairs.iter().map(|pair| pair.raw_bytes).sum();
    CoverageAnswer {
        terrain_version,
        origin_m: [grid.origin.x, grid.origin.y],
        resolution_m: grid.resolution,
        size: [grid.nx, grid.ny],
        mask_base64: STANDARD.encode(bytes),
        cameras,
        hidden: Vec::new(),
        hidden_base64: String::new(),
        seen_share: share(mask.iter().filter(|cell| **cell != 0).count()),
        raw_bytes,
        downlink_s: seconds(raw_bytes, rate),
        cost: ImageCost { bytes: 0, downlink_s: None, total_s: 0.0 },
    }
}

/// Makes a new version of the map of what pairs see, as a job: images over the link, matching, self-mask,
/// blending. One at a time. `pairs` of the job tells how far each pair is; cancelled, it lets the images go.
#[utoipa::path(
    post, path = "/terrain/reconstructions", tag = "terrain", request_body = ReconstructionRequest,
    responses(
        (status = 202, body = JobReport), (status = 409, body = ErrorBody),
        (status = 422, body = ErrorBody), (status = 429, body = ErrorBody)
    )
)]
async fn start_reconstruction(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(request): Body<ReconstructionRequest>,
) -> Result<(StatusCode, Json<JobReport>), ApiError> {
    let report = reconstruction::start(app, who, request).await?;
    Ok((StatusCode::ACCEPTED, Json(report)))
}

/// Makes the map that cameras had made in an earlier session again, from the images in its log, as a job: the same version,
/// byte for byte, or none. The images that were received last come back, too. A server that is started anew does this
/// by itself with the log of the session before.
#[utoipa::path(
    post, path = "/terrain/restore", tag = "terrain", request_body = RestoreRequest,
    responses(
        (status = 202, body = JobReport), (status = 404, body = ErrorBody),
        (status = 429, body = ErrorBody)
    )
)]
async fn restore_map(
    State(app): State<AppState>,
    Operator(who): Operator,
    Body(request): Body<RestoreRequest>,
) -> Result<(StatusCode, Json<JobReport>), ApiError> {
    let report = restore::start(&app, who, request.log, false).await?;
    Ok((StatusCode::ACCEPTED, Json(report)))
}

/// What a reconstruction gave, pair by pair, and what changed in the map.
#[utoipa::path(
    get, path = "/terrain/reconstructions/{id}", tag = "terrain",
    params(("id" = String, Path, description = "Identity of its job")),
    responses((status = 200, body = ReconstructionAnswer), (status = 404, body = ErrorBody))
)]
async fn reconstruction_answer(
    State(app): State<AppState>,
    Path(id): Path<String>,
) -> Result<Json<ReconstructionAnswer>, ApiError> {
    Ok(Json(app.reconstructions.answer(&id)?))
}
