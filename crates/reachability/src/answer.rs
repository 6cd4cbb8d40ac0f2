//! What is asked and what is answered.

use geometry::{Grid, Raster};
use stability::rule::Preference;
use terrain::traversability::Layers;

pub use collision::WheelHeading;

/// What a cell is for the leg (F45). FootFall's colors: green, red, orange, blue; colliding and
/// unknown are told apart from unreachable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellClass {
    /// The ground there is unknown.
    Unknown = 0,
    /// No joint angles bring the wheel there, or the ground is no place for a wheel (FootFall: red).
    Unreachable = 1,
    /// The rover would not be stable with the leg there (orange).
    Unstable = 2,
    /// The waypoint above it, or above the start, cannot be reached (blue).
    NoLift = 3,
    /// The wheel can stand there (green).
    Reachable = 4,
    /// The leg would touch something or come too near.
    Colliding = 5,
}

impl CellClass {
    /// All classes, by their number.
    pub const ALL: [CellClass; 6] = [
        CellClass::Unknown,
        CellClass::Unreachable,
        CellClass::Unstable,
        CellClass::NoLift,
        CellClass::Reachable,
        CellClass::Colliding,
    ];

    /// The class of that number; unknown for a number of none.
    pub fn from_number(number: u8) -> CellClass {
        CellClass::ALL.get(usize::from(number)).copied().unwrap_or(CellClass::Unknown)
    }
}

/// Why a cell is not reachable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// It is reachable.
    None = 0,
    /// Out of the leg's reach; missing: meters.
    OutOfReach = 1,
    /// A joint would be beyond its limit; missing: radians.
    JointLimit = 2,
    /// Nobody has seen the ground there.
    UnknownGround = 3,
    /// Too little regular or conservative margin; missing: meters.
    Margin = 4,
    /// Would not survive the settlement of a foot; missing: meters.
    Settlement = 5,
    /// Too near to ground or an obstacle; missing: meters.
    EnvironmentCollision = 6,
    /// Too near to another part of the robot; missing: meters.
    SelfCollision = 7,
    /// The waypoint above cannot be reached; missing: meters.
    LiftOutOfReach = 8,
    /// Something is in the way at the waypoint above; missing: meters.
    LiftCollides = 9,
    /// A joint would be overloaded; missing: share of its torque limit.
    Torque = 10,
    /// The ground under the wheel is too uneven; missing: meters.
    Uneven = 11,
    /// The leg cannot be lifted where it stands.
    StartLift = 12,
    /// The ground under the wheel is of the class "unsafe"; missing: goodness, if its threshold is
    /// known.
    Traversability = 13,
}

impl Reason {
    /// All reasons, by their number.
    pub const ALL: [Reason; 14] = [
        Reason::None,
        Reason::OutOfReach,
        Reason::JointLimit,
        Reason::UnknownGround,
        Reason::Margin,
        Reason::Settlement,
        Reason::EnvironmentCollision,
        Reason::SelfCollision,
        Reason::LiftOutOfReach,
        Reason::LiftCollides,
        Reason::Torque,
        Reason::Uneven,
        Reason::StartLift,
        Reason::Traversability,
    ];

    /// The reason of that number; none for a number of no reason.
    pub fn from_number(number: u8) -> Reason {
        Reason::ALL.get(usize::from(number)).copied().unwrap_or(Reason::None)
    }
}

/// Ground that is judged, for refusing what is unsafe: the layers of [`terrain::traversability`] over
/// the same map.
#[derive(Debug, Clone, Copy)]
pub struct GroundClasses<'a> {
    /// The layers.
    pub layers: &'a Layers,
    /// The goodness below which they call a cell unsafe.
    pub unsafe_below: f64,
}

/// What is asked of [`reach`](crate::reach).
#[derive(Debug, Clone, Copy)]
pub struct ReachOptions<'a> {
    /// Distance between cells (m).
    pub resolution: f64,
    /// Height of the waypoints above start and goal (m) (F46).
    pub lift: f64,
    /// Which loss of support must be survived.
    pub preference: Preference,
    /// Coefficient of friction under all feet, for [`Preference::Friction`].
    pub friction: f64,
    /// Which way the wheel may roll where it is put down.
    pub heading: WheelHeading,
    /// Refuse ground that is unsafe here; none to take all ground.
    pub ground: Option<GroundClasses<'a>>,
    /// Threads to use, 1 or more.
    pub workers: usize,
}

impl Default for ReachOptions<'_> {
    /// Cells of 0.1 m, a lift of 0.2 m, the regular rule, friction 0.7, a free wheel on any ground, one
    /// thread.
    fn default() -> Self {
        ReachOptions {
            resolution: 0.1,
            lift: 0.2,
            preference: Preference::Regular,
            friction: 0.7,
            heading: WheelHeading::Free,
            ground: None,
            workers: 1,
        }
    }
}

/// The answer for one leg.
#[derive(Debug, Clone, PartialEq)]
pub struct ReachGrid {
    /// What each cell is.
    pub class: Raster<u8>,
    /// Why, as [`Reason`].
    pub reason: Raster<u8>,
    /// How much is missing, in the unit of the reason; NaN where nothing is.
    pub missing: Raster<f32>,
    /// Regular margin with the leg there, just before it takes load (m); NaN where there is none.
    pub margin: Raster<f32>,
}

impl ReachGrid {
    /// Where the cells lie.
    pub fn grid(&self) -> &Grid {
        self.class.grid()
    }

    pub(crate) fn of(grid: Grid, cells: &[Cell]) -> Option<ReachGrid> {
        Some(ReachGrid {
            class: Raster::new(grid, cells.iter().map(|c| c.class as u8).collect())?,
            reason: Raster::new(grid, cells.iter().map(|c| c.reason as u8).collect())?,
            missing: Raster::new(grid, cells.iter().map(|c| c.missing).collect())?,
            margin: Raster::new(grid, cells.iter().map(|c| c.margin).collect())?,
        })
    }
}

/// The answer for one cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cell {
    pub class: CellClass,
    pub reason: Reason,
    pub missing: f32,
    pub margin: f32,
}

impl Cell {
    pub fn new(class: CellClass, reason: Reason, missing: f64) -> Cell {
        Cell { class, reason, missing: missing as f32, margin: f32::NAN }
    }
}
