//! The answers before, and what has changed of the ground since.

use std::collections::BTreeMap;
use std::sync::Arc;

use geometry::Raster;
use nalgebra::Point2;
use reachability::Area;
use terrain::cover::CoverLimits;

use super::Known;
use crate::scene::Context;
use crate::terrain_store::Version;

/// Cells by the place of their resolution in the list, and leg.
pub(super) type Answers = BTreeMap<(usize, String), Known>;

/// The last answers that came to an end.
#[derive(Default)]
pub(super) struct Before {
    /// Stance and preference that they are for.
    stance: String,
    /// The map.
    version: Option<Arc<Version>>,
    answers: Answers,
}

/// What has changed of the ground under one stance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Changed {
    /// Nothing that a leg could meet.
    Nothing,
    /// What lies in here.
    Within(Area),
    /// Everything, or nobody knows.
    All,
}

impl Before {
    /// What has changed since the answers before, if they are for this stance.
    pub fn changed(&self, stance: &str, context: &Context) -> Changed {
        match (&self.version, &context.live) {
            (Some(before), Some(live)) if self.stance == stance => {
                between(before, &live.version, &context.config.unknown_ground.limits())
            }
            _ => Changed::All,
        }
    }

    /// An answer before.
    pub fn answer(&self, closeness: usize, leg: &str) -> Option<Known> {
        self.answers.get(&(closeness, leg.to_owned())).cloned()
    }

    /// Keeps all answers to one question.
    pub fn keep(&mut self, stance: String, context: &Context, answers: Answers) {
        self.version = context.live.as_ref().map(|live| live.version.clone());
        (self.stance, self.answers) = (stance, answers);
    }
}

/// What differs between two versions: heights, and what is judged of them.
fn between(before: &Version, after: &Version, limits: &CoverLimits) -> Changed {
    let same_rule = before.unsafe_below().to_bits() == after.unsafe_below().to_bits();
    if before.map.grid() != after.map.grid() || !same_rule {
        return Changed::All;
    }
    let mut changed = None;
    widen(&mut changed, before.map.heights(), after.map.heights(), f32::to_bits);
    match (before.layers(), after.layers()) {
        (Ok(a), Ok(b)) if a.class.grid() == b.class.grid() => {
            widen(&mut changed, &a.class, &b.class, |class| class);
            widen(&mut changed, &a.goodness, &b.goodness, f32::to_bits);
        }
        (Err(_), Err(_)) => {}
        _ => return Changed::All,
    }
    // What is unknown has another bound too where ground about it changed.
    match (before.cover(limits), after.cover(limits)) {
        (Some(a), Some(b)) if a.grid() == b.grid() => {
            widen(&mut changed, a.heights(), b.heights(), f32::to_bits);
        }
        (None, None) => {}
        _ => return Changed::All,
    }
    changed.map_or(Changed::Nothing, Changed::Within)
}

/// Widens an area by the nodes in which two rasters over one grid differ.
fn widen<T: Copy, B: PartialEq>(
    area: &mut Option<Area>,
    before: &Raster<T>,
    after: &Raster<T>,
    bits: impl Fn(T) -> B,
) {
    let grid = before.grid();
    let pairs = before.values().iter().zip(after.values());
    for (i, _) in pairs.enumerate().filter(|(_, (a, b))| bits(**a) != bits(**b)) {
        let p = grid.position(i % grid.nx, i / grid.nx);
        let so_far = area.get_or_insert(Area { min: p, max: p });
        so_far.min = Point2::new(so_far.min.x.min(p.x), so_far.min.y.min(p.y));
        so_far.max = Point2::new(so_far.max.x.max(p.x), so_far.max.y.max(p.y));
    }
}

#[cfg(test)]
mod tests {
    use rover::{Configuration, LegId, Posture};
    use terrain::synthetic::{self, Recipe};
    use terrain::{ElevationMap, Source};
    use wire::analysis::{ReachabilityCells, ReachabilityRequest};
    use wire::check::At;
    use wire::time::Timestamp;

    use super::*;
    use crate::config::Config;
    use crate::robots::Robots;
    use crate::scene::LiveScene;
    use crate::stop::Stop;
    use crate::terrain_store::TerrainStore;
    use crate::terrains::{FileRoot, Terrains};

    /// The bent rover in the level middle of boulders, some of which are raised by `by` (m) within an area.
    fn on(by: f32, [x, y]: [f64; 2]) -> Context {
        let mut recipe = Recipe::from_name("boulder_field").unwrap();
        (recipe.width_m, recipe.height_m, recipe.resolution_m) = (12.0, 12.0, 0.1);
        recipe.flat_center_m = 3.0;
        let map = synthetic::generate(&recipe, 3).unwrap();
        let grid = *map.grid();
        let raised = Raster::from_fn(grid, |ix, iy| {
            let p = grid.position(ix, iy);
            let inside = (p.x - x).abs() < 0.25 && (p.y - y).abs() < 0.25;
            map.heights().at(ix, iy) + if inside { by } else { 0.0 }
        });
        let map = ElevationMap::new(raised, Source::file("changed"));
        let robots = Arc::new(Robots::new(Vec::new()));
        let robot = robots.load(&At::root("robot"), "athlete").unwrap();
        let pose = robot.pose("bent").unwrap();
        let wheel = Posture::new(&robot, &pose).wheel(&robot, LegId(0));
        let mut configuration: Configuration = pose;
        configuration.world_from_base.translation.vector.z -=
            wheel.lowest_point(&nalgebra::Vector3::z_axis()).z;
        let config = Config::demo();
        let store = TerrainStore::new(map, Timestamp(5), 0.3, Default::default(), 2);
        let version = store.current();
        Context {
            robots,
            terrains: Arc::new(Terrains::new(FileRoot::Relative("".into()), None)),
            config: Arc::new(config),
            live: Some(LiveScene {
                robot,
                map: version.map.clone(),
                version,
                gravity: 1.62,
                friction: 0.7,
                configuration: Some(configuration),
            }),
        }
    }

    fn bits(cells: &ReachabilityCells) -> Vec<(u8, u8, u32, u32)> {
        let classes = cells.class.iter().zip(&cells.reason);
        let all = classes.zip(cells.missing.iter().zip(&cells.margin));
        all.map(|((c, r), (a, b))| (*c, *r, a.to_bits(), b.to_bits())).collect()
    }

    #[test]
    fn cells_brought_up_to_date_after_a_change_of_the_map_are_those_found_anew() {
        let request = ReachabilityRequest {
            legs: Some(vec!["leg1".into()]),
            resolution_m: Some(0.1),
            ..ReachabilityRequest::default()
        };
        let stop = Stop::after(None).unwrap();
        let first = on(0.0, [0.0; 2]);
        let anew = |context: &Context| {
            let mut reached = crate::analyses::reachability(context, &request, 1, &stop).unwrap();
            reached.remove(0).1
        };
        let cells = Arc::new(anew(&first));
        let mut before = Before::default();
        assert_eq!(before.changed("here", &first), Changed::All);
        let answers = Answers::from([((0, "leg1".into()), cells.clone())]);
        before.keep("here".into(), &first, answers);
        assert_eq!(before.changed("elsewhere", &first), Changed::All);
        assert_eq!(before.changed("here", &on(0.0, [0.0; 2])), Changed::Nothing);
        // Beside the leg, under its foot, and far from it.
        let mut n_changed = 0;
        for place in [[2.9, 0.6], [2.3, 0.0], [-5.0, 4.0]] {
            let after = on(0.2, place);
            let changed = before.changed("here", &after);
            let Changed::Within(area) = changed else { panic!("{changed:?}") };
            // What is judged of the ground reaches farther than the heights.
            assert!(area.min.x <= place[0] - 0.15 && area.max.x >= place[0] + 0.15, "{area:?}");
            assert!(area.max.x - area.min.x < 2.0 && area.max.y - area.min.y < 2.0, "{area:?}");
            let known = before.answer(0, "leg1");
            let again =
                super::super::reached(&after, &request, known.as_ref(), &changed, &stop).unwrap();
            let anew = anew(&after);
            assert_eq!(bits(&again[0].1), bits(&anew), "{place:?}");
            n_changed += usize::from(bits(&anew) != bits(&cells));
        }
        assert_eq!(n_changed, 2);
        let reached =
            super::super::reached(&first, &request, Some(&cells), &Changed::Nothing, &stop);
        assert_eq!(bits(&reached.unwrap()[0].1), bits(&cells));
    }
}
