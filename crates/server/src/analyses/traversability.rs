//! Traversability of a ground.

use geometry::Raster;
use terrain::Placement;
use terrain::traversability::{Layers, traversability as judge};
use wire::analysis::{
    TRAVERSABILITY_LAYERS, TraversabilityAnswer, TraversabilityRequest, base64_bytes, base64_f32,
};
use wire::check::{At, RequestError};
use wire::tile::{Format, Header};

use crate::scene::Context;
use crate::stop::Stop;
use crate::terrains::terrain_error;

/// Most cells of an answer that is not a file.
const ANSWER_CELLS_MAX: usize = 4_000_000;

/// The layers, before they are encoded, and where they lie.
pub struct Judged(Layers, Placement);

/// Where a foot can stand.
pub fn traversability(
    context: &Context,
    request: &TraversabilityRequest,
    stop: &Stop,
) -> Result<Judged, RequestError> {
    let at = At::root("terrain");
    let map = context.terrain(&at, request.terrain.as_ref())?;
    stop.check()?;
    let defaults = &context.config.traversability;
    let footprint_m = request.footprint_m.unwrap_or(defaults.footprint_m);
    let limits = request.limits.over(&defaults.limits());
    limits.check().map_err(|error| terrain_error(&At::root("limits"), &error))?;
    // The map in use is judged with the same trust and doubt as its layers.
    let live = context.live.as_ref().filter(|_| request.terrain.is_none());
    let layers = match live {
        Some(live) => live.version.judged(footprint_m, &limits),
        None => judge(&map, footprint_m, &limits),
    };
    let layers = layers.map_err(|error| terrain_error(&At::root("footprint_m"), &error))?;
    stop.check()?;
    Ok(Judged(layers, map.placement().clone()))
}

impl Judged {
    /// All but the layers themselves.
    pub fn summary(&self) -> TraversabilityAnswer {
        let layers = &self.0;
        let grid = layers.class.grid();
        let mut class_cells = [0; 4];
        for class in layers.class.values() {
            class_cells[usize::from(*class).min(3)] += 1;
        }
        TraversabilityAnswer {
            layers: TRAVERSABILITY_LAYERS.map(String::from).into(),
            origin_m: [grid.origin.x, grid.origin.y],
            resolution_m: layers.resolution_m,
            size: [grid.nx, grid.ny],
            source_resolution_m: layers.source_resolution_m,
            footprint_m: layers.footprint_m,
            window: layers.window,
            class_cells,
            ..TraversabilityAnswer::default()
        }
    }

    /// As JSON has it; refused where it would be too large.
    pub fn to_answer(&self) -> Result<TraversabilityAnswer, RequestError> {
        self.check_size()?;
        let layers = &self.0;
        let text = |layer: &Raster<f32>| Some(base64_f32(layer.values()));
        Ok(TraversabilityAnswer {
            slope_rad: text(&layers.slope_rad),
            roughness_m: text(&layers.roughness_m),
            step_m: text(&layers.step_m),
            goodness: text(&layers.goodness),
            certainty: text(&layers.certainty),
            class: Some(base64_bytes(layers.class.values())),
            ..self.summary()
        })
    }

    fn check_size(&self) -> Result<(), RequestError> {
        let n_cells = self.0.class.grid().len();
        if n_cells <= ANSWER_CELLS_MAX {
            return Ok(());
        }
        let text = format_args!(
            "has {n_cells} cells to judge; an answer holds {ANSWER_CELLS_MAX}, so crop it, take a \
             larger footprint, or write a file with `footfall traversability --out`"
        );
        Err(RequestError::at("too_many", &At::root("terrain"), text))
    }

    /// As planes of f32 behind a header of `wire::tile`, in the order of the layers.
    pub fn to_binary(&self) -> Result<Vec<u8>, RequestError> {
        self.check_size()?;
        let grid = self.0.class.grid();
        let header = Header {
            format: Format::F32,
            planes: TRAVERSABILITY_LAYERS.len() as u16,
            size: [grid.nx as u32, grid.ny as u32],
            origin_m: [grid.origin.x, grid.origin.y],
            resolution_m: grid.resolution,
            z_min_m: 0.0,
            z_scale_m: 0.0,
            time_ns: 0,
        };
        let mut out = header.encode().to_vec();
        for layer in self.bands() {
            out.extend(layer.values().iter().flat_map(|value| value.to_le_bytes()));
        }
        Ok(out)
    }

    /// As the bands of one GeoTIFF.
    pub fn to_geotiff(&self) -> Result<Vec<u8>, RequestError> {
        let bands = self.bands();
        let named: Vec<_> = TRAVERSABILITY_LAYERS.into_iter().zip(&bands).collect();
        terrain::formats::geotiff::write_layers(self.0.class.grid(), &named, &self.1)
            .map_err(|error| terrain_error(&At::root("layers"), &error))
    }

    fn bands(&self) -> [Raster<f32>; 6] {
        let layers = &self.0;
        let class = layers.class.values().iter().map(|class| f32::from(*class)).collect();
        let class = Raster::new(*layers.class.grid(), class).expect("one class per node");
        [
            layers.slope_rad.clone(),
            layers.roughness_m.clone(),
            layers.step_m.clone(),
            layers.goodness.clone(),
            layers.certainty.clone(),
            class,
        ]
    }
}
