//! Regions of centers of mass as answers.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Point2, Point3};
use stability::ForceRegion;
use stability::force_region::Emptiness;
use stability::support_polygon;
use wire::live::{PolygonAnswer, RegionAnswer, RegionKind};

/// Contacts by their names, as every answer writes them: `leg2, leg3`.
pub fn names(contacts: &[usize], named: impl Fn(usize) -> String) -> Option<String> {
    let names: Vec<String> = contacts.iter().map(|contact| named(*contact)).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// A support polygon; `named` names one contact.
pub fn polygon_answer(
    polygon: &ConvexPolygon,
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    named: impl Fn(usize) -> String,
) -> PolygonAnswer {
    let margin = support_polygon::margin(polygon, contacts, com);
    area_answer(polygon, com, names(&margin.contacts, named))
}

fn area_answer(
    polygon: &ConvexPolygon,
    com: &Point3<f64>,
    critical: Option<String>,
) -> PolygonAnswer {
    let (margin_m, edge) = polygon.depth_and_edge(com.xy());
    let edge = polygon.edges().nth(edge);
    PolygonAnswer {
        polygon_m: polygon.vertices().iter().map(plain).collect(),
        area_m2: polygon.area(),
        margin_m,
        critical_edge_m: edge.map(|(a, b)| [plain(&a), plain(&b)]),
        critical,
    }
}

fn point_answer(point: &Point2<f64>, com: &Point3<f64>) -> PolygonAnswer {
    PolygonAnswer {
        polygon_m: vec![plain(point)],
        area_m2: 0.0,
        margin_m: -(com.xy() - point).norm(),
        critical_edge_m: None,
        critical: None,
    }
}

/// The conservative support region; `named` names one contact.
pub fn region_answer(
    region: &ConvexRegion,
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    named: impl Fn(usize) -> String,
) -> (Option<PolygonAnswer>, RegionKind) {
    match region {
        ConvexRegion::Area(polygon) => {
            (Some(polygon_answer(polygon, contacts, com, named)), RegionKind::Area)
        }
        ConvexRegion::Point(point) => (Some(point_answer(point, com)), RegionKind::Point),
        ConvexRegion::Empty => (None, RegionKind::Empty),
    }
}

/// A region that forces hold; `named` names one contact.
pub fn force_region_answer(
    found: &ForceRegion,
    com: &Point3<f64>,
    named: impl Fn(usize) -> String,
) -> RegionAnswer {
    let (kind, region) = match &found.region {
        ConvexRegion::Area(polygon) => {
            let critical = names(found.critical(com), named);
            (RegionKind::Area, Some(area_answer(polygon, com, critical)))
        }
        ConvexRegion::Point(point) => (RegionKind::Point, Some(point_answer(point, com))),
        ConvexRegion::Empty => (RegionKind::Empty, None),
    };
    RegionAnswer {
        kind,
        region,
        why_empty: found.emptiness.map(|why| emptiness_text(why).into()),
        capped: found.capped,
    }
}

/// Why a region is empty, for people.
pub fn emptiness_text(why: Emptiness) -> &'static str {
    match why {
        Emptiness::Slides => {
            "no forces of these contacts carry the weight: the ground is too steep for its friction, \
             or joints or ropes are too weak"
        }
        Emptiness::Twists => {
            "forces that carry the weight would turn the rover about gravity: there is too little \
             friction against it"
        }
        Emptiness::Overloaded => "a leg is too weak to hold its own links",
        Emptiness::NoneSurvives => "no center of mass is held whichever contact is lost",
    }
}

fn plain(p: &Point2<f64>) -> [f64; 2] {
    [p.x, p.y]
}
