//! Why a terrain operation refused its input. Always bad input, never a bug.

/// Bad input to a terrain operation: which field, which value, what to do instead.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TerrainError {
    /// A number that is not finite or lies outside what the field allows.
    #[error("{field} is {value}: give {expected}")]
    OutOfRange {
        /// The field, with its unit in the name.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What the field takes.
        expected: &'static str,
    },
    /// A layer that does not lie on the map's nodes.
    #[error(
        "{what} lies on a grid of {}x{} nodes, the map on one of {}x{}, or elsewhere: \
         give it on the map's own grid",
        found[0], found[1], expected[0], expected[1]
    )]
    OtherGrid {
        /// The layer.
        what: &'static str,
        /// Its nodes along x and y.
        found: [usize; 2],
        /// Those of the map.
        expected: [usize; 2],
    },
    /// A point whose position or variance is unusable.
    #[error("points[{index}].{field} is {value}: give a value from {low} to {high}")]
    Point {
        /// Which point.
        index: usize,
        /// The field.
        field: &'static str,
        /// What was given.
        value: f64,
        /// Least value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// An input that would make the map larger than allowed.
    #[error(
        "the map would have {n_tiles} tiles, more than the {tiles_max} allowed: crop the input"
    )]
    TooManyTiles {
        /// Tiles it would have.
        n_tiles: usize,
        /// Tiles allowed.
        tiles_max: usize,
    },
    /// An input on a lattice of another resolution.
    #[error("the input has cells of {found_m} m, the map of {expected_m} m: rasterize it anew")]
    OtherResolution {
        /// Its resolution (m).
        found_m: f64,
        /// The map's (m).
        expected_m: f64,
    },
    /// A pair that is already in the map, or is not.
    #[error("source {source_id} is {state} the map: {mend}")]
    MapSource {
        /// Its number.
        source_id: u32,
        /// `already in` or `not in`.
        state: &'static str,
        /// What to do instead.
        mend: &'static str,
    },
    /// A map with more nodes than allowed, refused before any memory is taken.
    #[error(
        "the map would have {n_nodes} nodes, more than the {max_nodes} allowed: \
         crop it or use a coarser resolution"
    )]
    TooManyNodes {
        /// Nodes the map would have.
        n_nodes: u64,
        /// Nodes allowed.
        max_nodes: u64,
    },
    /// A map too small to hold a surface.
    #[error("a map of {nx} x {ny} nodes holds no surface: give 2 x 2 nodes or more")]
    TooFewNodes {
        /// Nodes along x.
        nx: usize,
        /// Nodes along y.
        ny: usize,
    },
    /// A crop that holds fewer than 2 x 2 nodes of the map.
    #[error(
        "the crop of {width_m} m around ({x_m}, {y_m}) m holds {nx} x {ny} nodes of the map: \
         give a crop that holds 2 x 2 nodes or more"
    )]
    CropTooSmall {
        /// Center x (m).
        x_m: f64,
        /// Center y (m).
        y_m: f64,
        /// Side of the square (m).
        width_m: f64,
        /// Nodes along x inside it.
        nx: usize,
        /// Nodes along y inside it.
        ny: usize,
    },
    /// No node of the map has a height.
    #[error("no node of the map has a known height: check the file's nodata value")]
    NoKnownHeight,
    /// A height no planet has, most likely a nodata value that the file does not declare.
    #[error("a height of {z_m} m is out of range (1e7 m): declare the file's nodata value")]
    HeightOutOfRange {
        /// The height (m).
        z_m: f64,
    },
    /// A file whose name ends in nothing we read.
    #[error(
        "terrain file {file_name:?} has no supported extension: use .tif, .img, .lbl, .off, .obj, .ply or .png"
    )]
    UnknownFormat {
        /// The file's name as given.
        file_name: String,
    },
    /// No recipe of that name.
    #[error("there is no recipe {name:?}: use boulder_field, smooth_mare or rough_highlands")]
    UnknownRecipe {
        /// The name as given.
        name: String,
    },
    /// A recipe that asks for more rocks or craters than can be placed.
    #[error(
        "the recipe asks for about {expected:.0} {what}, more than the {max} allowed: \
         raise the smallest diameter or use a smaller map"
    )]
    TooManyFeatures {
        /// Rocks or craters.
        what: &'static str,
        /// Expected number.
        expected: f64,
        /// Number allowed.
        max: u64,
    },

    /// An OFF file that does not start as one.
    #[error("off line {line}: expected `OFF` and the counts, found {found:?}")]
    OffHeader {
        /// Line number, from 1.
        line: usize,
        /// The text there.
        found: String,
    },
    /// An OFF file that ends before its counts are used up.
    #[error("off file ends after {found} of {expected} {what}: it is truncated")]
    OffTruncated {
        /// Vertices or faces.
        what: &'static str,
        /// As the header says.
        expected: u64,
        /// As many as the file holds, or could at most.
        found: u64,
    },
    /// Text where a number belongs.
    #[error("mesh line {line}: {found:?} is not {expected}")]
    MeshNumber {
        /// Line number, from 1.
        line: usize,
        /// The text there.
        found: String,
        /// What belongs there.
        expected: &'static str,
    },
    /// A vertex that is NaN or infinite.
    #[error("mesh line {line}: a coordinate is {value}: leave out unknown vertices' faces instead")]
    MeshNotFinite {
        /// Line number, from 1.
        line: usize,
        /// The value.
        value: f64,
    },
    /// A face with a number of corners we do not read.
    #[error("mesh line {line}: a face has {n_corners} corners: use triangles or quadrilaterals")]
    MeshFaceCorners {
        /// Line number, from 1.
        line: usize,
        /// Number of corners.
        n_corners: u64,
    },
    /// A face that uses a vertex that is not there.
    #[error("mesh line {line}: vertex index {index} is out of range (0..{n_vertices})")]
    MeshIndex {
        /// Line number, from 1.
        line: usize,
        /// The index.
        index: u64,
        /// Number of vertices.
        n_vertices: usize,
    },
    /// A mesh whose vertices are not the nodes of a regular square grid, in rows or in columns.
    #[error("mesh is not a height field on a regular square grid: {reason}")]
    MeshNotAGrid {
        /// What is wrong, with the vertex or count.
        reason: String,
    },
    /// A square of the grid that no face covers although its four corners are known.
    #[error(
        "mesh has a hole at square ({ix}, {iy}) between four known vertices, which an \
         elevation map cannot hold: fill it, or drop all faces at one of its corners"
    )]
    MeshHole {
        /// Column of the square.
        ix: usize,
        /// Row of the square.
        iy: usize,
    },

    /// A PDS3 label that cannot be read, or says what is not read.
    #[error("pds3 label: {key} {reason}")]
    Pds3Label {
        /// The keyword.
        key: String,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// A PDS3 image that ends before its last line.
    #[error("pds3 image ends at byte {n_bytes}, its label asks for {needed}: it is truncated")]
    Pds3Truncated {
        /// Length of the file (bytes).
        n_bytes: u64,
        /// As much as the label asks for (bytes).
        needed: u64,
    },
    /// A PNG that cannot be read as heights.
    #[error("png heights: {reason}")]
    Png {
        /// What is wrong, and what to do.
        reason: String,
    },
    /// A PLY file that cannot be read as points.
    #[error("ply {place}: {reason}")]
    Ply {
        /// Header line or element.
        place: String,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// A file that goes with another one is not there.
    #[error("{file_name:?} needs {companion:?} beside it: give both files")]
    CompanionMissing {
        /// The file that was given.
        file_name: String,
        /// The file that is missing.
        companion: String,
    },

    /// A file that the TIFF decoder refuses: truncated, damaged, or with a compression unknown to it.
    #[error("geotiff cannot be read: {reason}")]
    TiffUnreadable {
        /// The decoder's words.
        reason: String,
    },
    /// A GeoTIFF with more than one band.
    #[error("geotiff has {n_bands} bands: extract the height band into a file of its own")]
    TiffBands {
        /// Number of bands.
        n_bands: u32,
    },
    /// A picture whose samples cannot be shown.
    #[error("the GeoTIFF is no picture that can be laid over ground: {what}")]
    PictureKind {
        /// What it is, and what would do.
        what: String,
    },
    /// A picture that lies elsewhere.
    #[error(
        "the picture lies from ({:.1}, {:.1}) to ({:.1}, {:.1}) m of its own coordinates, and the map from \
         ({:.1}, {:.1}) to ({:.1}, {:.1}) m: take a picture of this ground, in the coordinates of the map's file",
        .picture[0], .picture[1], .picture[2], .picture[3], .map[0], .map[1], .map[2], .map[3]
    )]
    PictureElsewhere {
        /// Least x, y, greatest x, y of the picture (m).
        picture: [f64; 4],
        /// The same of the map.
        map: [f64; 4],
    },
    /// A picture in another reference system than the map's.
    #[error(
        "the picture is in the reference system {picture:?} and the map in {map:?}, which differ in GeoKey {key}: project it \
         to that of the map, with gdalwarp for example"
    )]
    PictureOtherSystem {
        /// Name of the picture's.
        picture: String,
        /// Name of the map's.
        map: String,
        /// The first key in which they differ.
        key: u16,
    },
    /// A sample type we do not read as heights.
    #[error(
        "geotiff samples are {sample_type}: convert the heights to float32, float64 or int16 \
         in meters"
    )]
    TiffSampleType {
        /// The type, as `uint8`.
        sample_type: String,
    },
    /// Coordinates that are not a map plane.
    #[error("geotiff has {kind} coordinates: project it to a plane in meters")]
    TiffNotProjected {
        /// `geographic (degrees)` or `geocentric`.
        kind: &'static str,
    },
    /// A unit other than the meter.
    #[error("geotiff has {axis} unit code {code}: convert it to meters (9001)")]
    TiffUnit {
        /// `linear` or `vertical`.
        axis: &'static str,
        /// EPSG code of the unit.
        code: u16,
    },
    /// No usable place on the map.
    #[error("geotiff has no {tag}: georeference it (pixel scale and tie point)")]
    TiffNoTransform {
        /// What is missing.
        tag: &'static str,
    },
    /// A transform with rotation or shear.
    #[error("geotiff is rotated or sheared ({skew_x}, {skew_y}): warp it north-up")]
    TiffRotated {
        /// Shear of x with the row (m).
        skew_x: f64,
        /// Shear of y with the column (m).
        skew_y: f64,
    },
    /// Pixels that are not square, or of no size.
    #[error("geotiff pixels are {width_m} x {height_m} m: resample it to square pixels, north up")]
    TiffPixelSize {
        /// Along x (m).
        width_m: f64,
        /// Along y (m).
        height_m: f64,
    },
    /// A band with a scale or an offset to apply.
    #[error("geotiff band has {what} {value:?}: apply it and store plain meters")]
    TiffScaled {
        /// `scale` or `offset`.
        what: &'static str,
        /// The text of the tag.
        value: String,
    },
    /// Layers that cannot be written as one file.
    #[error("geotiff cannot be written: {reason}")]
    TiffWrite {
        /// Why.
        reason: String,
    },
}

impl TerrainError {
    /// `value` if it is finite and within `[min, max]`.
    pub(crate) fn check(
        field: &'static str,
        value: f64,
        [min, max]: [f64; 2],
        expected: &'static str,
    ) -> Result<f64, TerrainError> {
        if value.is_finite() && value >= min && value <= max {
            return Ok(value);
        }
        Err(TerrainError::OutOfRange { field, value, expected })
    }

    /// `Ok` if a map of `n_nodes` may be made.
    pub(crate) fn check_nodes(n_nodes: f64, max_nodes: usize) -> Result<(), TerrainError> {
        if n_nodes <= max_nodes as f64 {
            return Ok(());
        }
        Err(TerrainError::TooManyNodes { n_nodes: n_nodes as u64, max_nodes: max_nodes as u64 })
    }
}
