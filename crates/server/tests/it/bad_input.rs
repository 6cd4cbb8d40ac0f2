//! What is refused, and by which name. Each case asserts the code and the field.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::support::Ground;

const POSE: &str = r#"{"position_m":[0,0,2],"orientation_xyzw":[0,0,0,1]}"#;
const LEGS: &str = r#"{"leg1":[0,0,0,0,0,0],"leg2":[0,0,0,0,0,0],"leg3":[0,0,0,0,0,0],"leg4":[0,0,0,0,0,0],"leg5":[0,0,0,0,0,0],"leg6":[0,0,0,0,0,0]}"#;

/// Route below `/api/v1/`, body, code, field.
fn cases() -> Vec<(&'static str, String, &'static str, &'static str)> {
    let state = |base: &str, joints: &str| {
        format!(r#"{{"states":[{{"base":{base},"joints_rad":{joints}}}]}}"#)
    };
    let base = |q: &str| format!(r#"{{"position_m":[0,0,2],"orientation_xyzw":{q}}}"#);
    let scene = |text: &str| format!(r#"{{"scene":{{{text}}}}}"#);
    let case = |text: &str| format!(r#"{{"cases":[{{{text}}}]}}"#);
    let contact =
        |text: &str| format!(r#"{{"cases":[{{"com_m":[0,0,0],"contacts":[{{{text}}}]}}]}}"#);
    let plan = |text: &str| format!(r#"{{"leg":"leg1","target":{{"position_m":[2,0,0]}},{text}}}"#);
    let many = |n: usize, item: &str| vec![item; n].join(",");
    let hand = |text: &str| format!("{{\"body\":{{{text}}}}}");
    let waits = |text: &str| {
        format!(
            "{{\"body\":{{\"type\":\"mode\",\"mode\":\"safe\"}},\"preconditions\":[{{{text}}}]}}"
        )
    };
    let k = "analysis/kinematics";
    let i = "analysis/inverse-kinematics";
    let s = "analysis/stability";
    let r = "analysis/reachability";
    let t = "analysis/traversability";
    let p = "analysis/plan";
    vec![
        // the text
        (k, "".into(), "not_json", ""),
        ("authority/hand-over", "{\"to\":\" \"}".into(), "out_of_range", "to"),
        ("authority/hand-over", "{\"to\":\"bob\",\"epoch\":1}".into(), "unknown_field", "epoch"),
        ("commands/checks", "{\"dry\":true}".into(), "unknown_field", "dry"),
        (k, "{".into(), "not_json", ""),
        (k, "{} {}".into(), "not_json", ""),
        (k, "\u{feff}{}".into(), "not_json", ""),
        (k, "null".into(), "wrong_type", ""),
        (k, "[]".into(), "wrong_type", ""),
        (k, "{\"scene\":{},\"scene\":{}}".into(), "wrong_type", ""),
        (k, "{\"sceen\":{}}".into(), "unknown_field", "sceen"),
        (k, scene("\"robots\":\"x\""), "unknown_field", "scene.robots"),
        (k, "{\"states\":{}}".into(), "wrong_type", "states"),
        // numbers that are none
        (k, state(&base("[0,0,0,NaN]"), LEGS), "not_finite", "states[0].base.orientation_xyzw[3]"),
        (k, state(&base("[0,0,0,1e999]"), LEGS), "not_finite", "states[0].base.orientation_xyzw[3]"),
        (k, state(&base("[0,0,0,Infinity]"), LEGS), "not_finite", "states[0].base.orientation_xyzw[3]"),
        (k, state(&base("[0,0,0,-Infinity]"), LEGS), "not_finite", "states[0].base.orientation_xyzw[3]"),
        (k, scene("\"gravity_m_s2\":NaN"), "not_finite", "scene.gravity_m_s2"),
        // quaternions and normals
        (k, state(&base("[0,0,0,1.002]"), LEGS), "not_unit_quaternion", "states[0].base.orientation_xyzw"),
        (k, state(&base("[0,0,0,0]"), LEGS), "not_unit_quaternion", "states[0].base.orientation_xyzw"),
        (k, state(&base("[0,0,0]"), LEGS), "wrong_type", "states[0].base.orientation_xyzw"),
        (k, state(&base("[0,0,0,1,0]"), LEGS), "wrong_type", "states[0].base.orientation_xyzw"),
        (s, contact("\"position_m\":[0,0,0],\"normal\":[0,0,2]"), "not_unit_vector", "cases[0].contacts[0].normal"),
        (s, contact("\"position_m\":[0,0,0],\"normal\":[0,0,0]"), "not_unit_vector", "cases[0].contacts[0].normal"),
        (i, "{\"leg\":\"leg1\",\"targets\":[{\"position_m\":[0,0,0],\"axis\":[0,0,9]}]}".into(), "not_unit_vector", "targets[0].axis"),
        // states
        (k, state(POSE, "{}"), "leg_missing", "states[0].joints_rad"),
        (k, state(POSE, &LEGS.replace("leg6", "leg7")), "leg_unknown", "states[0].joints_rad.leg7"),
        (k, state(POSE, &LEGS.replace("\"leg3\":[0,0,0,0,0,0]", "\"leg3\":[0,0,0,0,0]")), "joint_count", "states[0].joints_rad.leg3"),
        (k, state(POSE, &LEGS.replace("\"leg3\":[0,0,0,0,0,0]", "\"leg3\":[0,0,0,0,0,0,0]")), "joint_count", "states[0].joints_rad.leg3"),
        (k, state(POSE, &LEGS.replace("\"leg3\":[0", "\"leg3\":[1e6")), "out_of_range", "states[0].joints_rad.leg3[0]"),
        (k, state(POSE, &LEGS.replace("\"leg3\":[0", "\"leg3\":[\"0\"")), "wrong_type", "states[0].joints_rad.leg3[0]"),
        (k, state("{\"position_m\":[0,0,1e9],\"orientation_xyzw\":[0,0,0,1]}", LEGS), "out_of_range", "states[0].base.position_m[2]"),
        (k, "{\"states\":[{\"joints_rad\":{}}]}".into(), "missing_field", "states[0]"),
        (k, "{\"links\":[\"nose\"]}".into(), "link_unknown", "links[0]"),
        (k, format!("{{\"states\":[{}]}}", many(10_001, &format!("{{\"base\":{POSE},\"joints_rad\":{{}}}}"))), "too_many", "states"),
        // scenes
        (k, scene("\"robot\":\"nobody\""), "robot_unknown", "scene.robot"),
        (k, scene("\"robot\":\"../athlete\""), "robot_unknown", "scene.robot"),
        (k, scene("\"robot\":\"\""), "robot_unknown", "scene.robot"),
        (k, scene("\"scale\":0"), "out_of_range", "scene.scale"),
        (k, scene("\"scale\":-1"), "out_of_range", "scene.scale"),
        (k, scene("\"scale\":5000"), "out_of_range", "scene.scale"),
        (k, scene("\"gravity_m_s2\":0"), "out_of_range", "scene.gravity_m_s2"),
        (k, scene("\"gravity_m_s2\":-1.62"), "out_of_range", "scene.gravity_m_s2"),
        (k, scene("\"payloads\":[{\"link\":\"nose\",\"mass_kg\":1,\"com_m\":[0,0,0]}]"), "link_unknown", "scene.payloads"),
        (k, scene("\"payloads\":[{\"link\":\"chassis\",\"mass_kg\":-1,\"com_m\":[0,0,0]}]"), "out_of_range", "scene.payloads[0].mass_kg"),
        (k, scene("\"payloads\":[{\"link\":\"chassis\",\"mass_kg\":1,\"com_m\":[0,0,0],\"shape\":{\"box_m\":[0,1,1]}}]"), "out_of_range", "scene.payloads[0].shape.box_m[0]"),
        (k, format!("{{\"scene\":{{\"payloads\":[{}]}}}}", many(101, "{\"link\":\"chassis\",\"mass_kg\":1,\"com_m\":[0,0,0]}")), "too_many", "scene.payloads"),
        // grounds
        (k, scene("\"terrain\":{}"), "terrain_ambiguous", "scene.terrain"),
        (k, scene("\"terrain\":{\"plane\":{},\"file\":\"a.tif\"}"), "terrain_ambiguous", "scene.terrain"),
        (k, scene("\"terrain\":{\"plane\":{},\"seed\":1}"), "terrain_ambiguous", "scene.terrain.seed"),
        (k, scene("\"terrain\":{\"plane\":{\"z\":1}}"), "unknown_field", "scene.terrain.plane.z"),
        (k, scene("\"terrain\":{\"plane\":{},\"friction\":-1}"), "out_of_range", "scene.terrain.friction"),
        (k, scene("\"terrain\":{\"plane\":{},\"offset_m\":[0,0,1e9]}"), "out_of_range", "scene.terrain.offset_m[2]"),
        (k, scene("\"terrain\":{\"file\":\"../../etc/passwd\"}"), "file_name_invalid", "scene.terrain.file"),
        (k, scene("\"terrain\":{\"file\":\"/etc/passwd\"}"), "file_name_invalid", "scene.terrain.file"),
        (k, scene("\"terrain\":{\"file\":\"a\\u0000.tif\"}"), "file_name_invalid", "scene.terrain.file"),
        (k, scene("\"terrain\":{\"file\":\"none.tif\"}"), "terrain_file_unknown", "scene.terrain.file"),
        (k, scene("\"terrain\":{\"version\":\"0\"}"), "terrain_unknown", "scene.terrain.version"),
        (k, scene("\"terrain\":{\"recipe\":{\"name\":\"beach\"}}"), "recipe_unknown", "scene.terrain.recipe"),
        (k, scene("\"terrain\":{\"recipe\":{\"name\":\"boulder_field\",\"width_m\":-1}}"), "out_of_range", "scene.terrain.recipe"),
        (k, scene("\"terrain\":{\"recipe\":{\"name\":\"boulder_field\",\"width_m\":90000}}"), "too_many", "scene.terrain.recipe"),
        // obstacles
        (k, scene("\"obstacles\":[{}]"), "wrong_type", "scene.obstacles[0]"),
        (k, scene("\"obstacles\":[{\"box_m\":[1,1,0],\"position_m\":[0,0,0],\"orientation_xyzw\":[0,0,0,1]}]"), "out_of_range", "scene.obstacles[0].box_m[2]"),
        (k, scene("\"obstacles\":[{\"box_m\":[1,1,1],\"position_m\":[0,0,0],\"orientation_xyzw\":[1,0,0,1]}]"), "not_unit_quaternion", "scene.obstacles[0].orientation_xyzw"),
        (k, scene("\"obstacles\":[{\"vertices_m\":[[0,0,0],[1,0,0],[0,1,0]],\"triangles\":[[0,1,2]]}]"), "obstacle_invalid", "scene.obstacles"),
        (k, scene("\"obstacles\":[{\"vertices_m\":[[0,0,0]],\"triangles\":[[0,1,2]]}]"), "obstacle_invalid", "scene.obstacles"),
        (k, format!("{{\"scene\":{{\"obstacles\":[{}]}}}}", many(1001, "{\"box_m\":[1,1,1],\"position_m\":[9,9,9],\"orientation_xyzw\":[0,0,0,1]}")), "too_many", "scene.obstacles"),
        // inverse kinematics
        (i, "{\"targets\":[]}".into(), "missing_field", ""),
        (i, "{\"leg\":\"leg9\",\"targets\":[]}".into(), "leg_unknown", "leg"),
        (i, "{\"leg\":\"leg1\",\"targets\":[{\"position_m\":[0,0,0]}]}".into(), "target_ambiguous", "targets[0]"),
        (i, "{\"leg\":\"leg1\",\"targets\":[{\"position_m\":[0,0,0],\"axis\":[0,0,1],\"orientation_xyzw\":[0,0,0,1]}]}".into(), "target_ambiguous", "targets[0]"),
        (i, format!("{{\"leg\":\"leg1\",\"targets\":[{}]}}", many(10_001, "{\"position_m\":[0,0,0],\"axis\":[0,0,1]}")), "too_many", "targets"),
        // stability
        (s, "{}".into(), "missing_field", ""),
        (s, case("\"contacts\":[]"), "missing_field", "cases[0]"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,1e9]"), "out_of_range", "cases[0].com_m[2]"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"mass_kg\":0"), "out_of_range", "cases[0].mass_kg"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"mass_kg\":-5"), "out_of_range", "cases[0].mass_kg"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"gravity_m_s2\":0"), "out_of_range", "cases[0].gravity_m_s2"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"cone_edges\":2"), "out_of_range", "cases[0].cone_edges"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"cone_edges\":8.5"), "wrong_type", "cases[0].cone_edges"),
        (s, contact("\"position_m\":[0,0,0],\"friction\":-0.1"), "out_of_range", "cases[0].contacts[0].friction"),
        (s, contact("\"position_m\":[0,0,0],\"color\":1"), "unknown_field", "cases[0].contacts[0].color"),
        (s, format!("{{\"cases\":[{}]}}", many(10_001, "{\"contacts\":[],\"com_m\":[0,0,0]}")), "too_many", "cases"),
        (s, format!("{{\"cases\":[{{\"com_m\":[0,0,0],\"contacts\":[{}]}}]}}", many(65, "{\"position_m\":[0,0,0]}")), "too_many", "cases[0].contacts"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"cone_bound\":\"loose\""), "wrong_type", "cases[0].cone_bound"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"uncertainty\":{\"normal_rad\":2}"), "out_of_range", "cases[0].uncertainty.normal_rad"),
        (s, case("\"contacts\":[],\"com_m\":[0,0,0],\"tethers\":[{\"position_m\":[0,0,0],\"direction\":[0,0,2],\"max_tension_n\":1}]"), "not_unit_vector", "cases[0].tethers[0].direction"),
        // reachability
        (r, "{\"legs\":[]}".into(), "empty", "legs"),
        (r, "{\"legs\":[\"arm\"]}".into(), "leg_unknown", "legs[0]"),
        (r, "{\"legs\":[\"leg1\",\"leg1\",\"leg1\",\"leg1\",\"leg1\",\"leg1\",\"leg1\"]}".into(), "too_many", "legs"),
        (r, "{\"resolution_m\":0}".into(), "out_of_range", "resolution_m"),
        (r, "{\"legs\":[\"leg1\"],\"resolution_m\":0.002}".into(), "too_many", "resolution_m"),
        (r, "{\"lift_m\":-0.1}".into(), "out_of_range", "lift_m"),
        (r, "{\"wheel_heading_rad\":99}".into(), "out_of_range", "wheel_heading_rad"),
        ("analysis/reachability/cell", "{\"leg\":\"leg9\",\"position_m\":[0,0]}".into(), "leg_unknown", "leg"),
        ("analysis/reachability/cell", "{\"leg\":\"leg1\",\"position_m\":[0,1e9]}".into(), "out_of_range", "position_m[1]"),
        (r, "{\"stability\":\"hope\"}".into(), "wrong_type", "stability"),
        (r, "{\"deadline_s\":0}".into(), "out_of_range", "deadline_s"),
        (r, "{\"deadline_s\":-1}".into(), "out_of_range", "deadline_s"),
        // traversability
        (t, "{\"footprint_m\":0}".into(), "out_of_range", "footprint_m"),
        (t, "{\"footprint_m\":-1}".into(), "out_of_range", "footprint_m"),
        (t, "{\"limits\":{\"slope\":1}}".into(), "unknown_field", "limits.slope"),
        (t, "{\"limits\":{\"slope_lo_rad\":0.9}}".into(), "out_of_range", "limits"),
        (t, "{\"limits\":{\"known_share_min\":2}}".into(), "out_of_range", "limits"),
        (t, "{\"terrain\":{\"file\":\"..\"}}".into(), "file_name_invalid", "terrain.file"),
        // plans
        ("analysis/posture", "{}".into(), "missing_field", "advice"),
        ("rover/posture", "{\"advise\":{}}".into(), "unknown_field", "advise"),
        ("rover/posture", "{\"advice\":{\"leg\":\"leg1\"},\"deadline_s\":0}".into(), "out_of_range", "deadline_s"),
        ("rover/posture/x/plans", "{}".into(), "posture_ambiguous", "proposal"),
        ("rover/posture/x/plans", "{\"proposal\":0,\"way_back\":{\"leg\":\"leg1\",\"kind\":\"lost\"}}".into(), "posture_ambiguous", "proposal"),
        ("rover/posture/x/plans", "{\"way_back\":{\"leg\":\"leg1\"}}".into(), "missing_field", "way_back"),
        ("rover/posture/x/plans", "{\"way_back\":{\"leg\":\"leg1\",\"kind\":\"stuck\"}}".into(), "wrong_type", "way_back.kind"),
        ("rover/posture/x/plans", "{\"proposal\":-1}".into(), "wrong_type", "proposal"),
        ("analysis/posture", "{\"advice\":{\"leg\":\"leg9\"}}".into(), "leg_unknown", "advice.leg"),
        ("analysis/posture", "{\"advice\":{\"leg\":\"leg1\",\"regular_m\":-1}}".into(), "out_of_range", "advice.regular_m"),
        ("analysis/posture", "{\"advice\":{\"leg\":\"leg1\",\"conservative_m\":1e999}}".into(), "not_finite", "advice.conservative_m"),
        ("analysis/posture", "{\"advice\":{\"leg\":\"leg1\",\"friction_m\":-1}}".into(), "out_of_range", "advice.friction_m"),
        ("analysis/posture", "{\"advice\":{\"leg\":\"leg1\",\"chassis\":\"up\"}}".into(), "wrong_type", "advice.chassis"),
        ("analysis/posture", "{\"rehearsal\":{\"settlement_m\":9}}".into(), "out_of_range", "rehearsal.settlement_m"),
        ("analysis/posture", "{\"rehearsal\":{},\"budget\":2000000}".into(), "out_of_range", "budget"),
        (p, "{}".into(), "missing_field", ""),
        (p, plan("\"leg\":\"leg2\""), "wrong_type", ""),
        (p, plan("\"planner\":\"magic\""), "wrong_type", "planner"),
        (p, plan("\"stability\":\"frictional\""), "wrong_type", "stability"),
        (p, plan("\"lift_m\":3"), "out_of_range", "lift_m"),
        (p, plan("\"budget\":0"), "out_of_range", "budget"),
        (p, plan("\"budget\":-1"), "wrong_type", "budget"),
        (p, plan("\"seed\":-1"), "wrong_type", "seed"),
        (p, plan("\"tolerances\":{\"environment_m\":-1}"), "out_of_range", "tolerances.environment_m"),
        (p, plan("\"smoothing\":{\"stop_reduction\":2}"), "out_of_range", "smoothing.stop_reduction"),
        (p, plan("\"transit_only\":true"), "target_ambiguous", "transit_only"),
        (p, "{\"leg\":\"leg1\",\"target\":{}}".into(), "target_ambiguous", "target"),
        (p, "{\"leg\":\"leg1\",\"target\":{\"joints_rad\":[1]}}".into(), "joint_count", "target.joints_rad"),
        (p, "{\"leg\":\"leg1\",\"target\":{\"position_m\":[1,2]}}".into(), "wrong_type", "target.position_m"),
        // the live rover
        ("plans", "{\"leg\":\"leg1\",\"target\":{},\"deadline_s\":0}".into(), "out_of_range", "deadline_s"),
        ("commands", "{}".into(), "target_ambiguous", ""),
        ("commands", "{\"plan\":{\"plan_id\":\"x\",\"index\":0}}".into(), "plan_unknown", ""),
        ("commands", "{\"body\":{\"type\":\"jump\"}}".into(), "wrong_type", "body.type"),
        ("commands", hand("\"type\":\"drive_arc\",\"distance_m\":NaN"), "not_finite", "body.distance_m"),
        ("commands", hand("\"type\":\"drive_arc\",\"distance_m\":1e999"), "not_finite", "body.distance_m"),
        ("commands", hand("\"type\":\"drive_arc\",\"distance\":1"), "unknown_field", "body"),
        ("commands", hand("\"type\":\"drive_arc\",\"distance_m\":1"), "command_invalid", "body"),
        ("commands", hand("\"type\":\"wheel_brake\",\"on\":false"), "command_invalid", "body"),
        ("commands", hand("\"type\":\"wheel_brake\",\"on\":true,\"legs\":[\"leg7\"]"), "command_invalid", "body"),
        ("commands", hand(&format!("\"type\":\"wheel_brake\",\"on\":true,\"legs\":[{}]", many(101, "\"leg1\""))), "too_many", "body.legs"),
        ("commands", hand("\"type\":\"joint_move\",\"joints_rad\":{}"), "command_invalid", "body"),
        ("commands", hand("\"type\":\"joint_move\",\"joints_rad\":{\"nose\":1}"), "command_invalid", "body"),
        ("commands", hand("\"type\":\"joint_move\",\"joints_rad\":{\"leg1_hip_yaw\":1e999}"), "not_finite", "body.joints_rad.leg1_hip_yaw"),
        ("commands", hand("\"type\":\"wheel_move\",\"leg\":\"leg1\",\"position_m\":[0,0,1e9]"), "out_of_range", "body.position_m[2]"),
        ("commands", hand("\"type\":\"wheel_move\",\"leg\":\"leg1\",\"frame\":\"moon\",\"position_m\":[0,0,1]"), "wrong_type", "body"),
        ("commands", hand("\"type\":\"body_move\",\"translation_m\":[0,0,5]"), "command_invalid", "body"),
        ("commands", hand("\"type\":\"mode\",\"mode\":\"party\""), "wrong_type", "body"),
        ("commands", hand("\"type\":\"sequence\",\"steps\":[]"), "command_invalid", "body"),
        ("commands", hand(&format!("\"type\":\"sequence\",\"steps\":[{}]", many(101, "{\"body\":{\"type\":\"hold\"}}"))), "too_many", "body.steps"),
        ("commands", hand("\"type\":\"sequence\",\"steps\":[{\"body\":{\"type\":\"stop\"}}]"), "command_invalid", "body.steps[0]"),
        ("commands", hand("\"type\":\"sequence\",\"steps\":[{\"body\":{\"type\":\"sequence\",\"steps\":[]}}]"), "command_invalid", "body.steps[0].body"),
        ("commands", hand("\"type\":\"sequence\",\"steps\":[{\"body\":{\"type\":\"hold\"}},{\"body\":{\"type\":\"drive_arc\",\"distance_m\":1}}]"), "command_invalid", "body.steps[1]"),
        ("commands", waits("\"channel\":\"moon\",\"field\":\"mode\",\"op\":\"eq\",\"value\":1,\"max_age_s\":5"), "command_invalid", "preconditions[0].channel"),
        ("commands", waits("\"channel\":\"rover/state\",\"field\":\"\",\"op\":\"eq\",\"value\":1,\"max_age_s\":5"), "out_of_range", "preconditions[0].field"),
        ("commands", waits("\"channel\":\"rover/state\",\"field\":\"mode\",\"op\":\"like\",\"value\":1,\"max_age_s\":5"), "wrong_type", "preconditions[0].op"),
        ("commands", waits("\"channel\":\"rover/state\",\"field\":\"mode\",\"op\":\"eq\",\"value\":[1],\"max_age_s\":5"), "command_invalid", "preconditions[0].value"),
        ("commands", waits("\"channel\":\"rover/state\",\"field\":\"mode\",\"op\":\"eq\",\"value\":1,\"max_age_s\":-1"), "out_of_range", "preconditions[0].max_age_s"),
        ("commands", "{\"body\":{\"type\":\"stop\"},\"id\":\"one\"}".into(), "id_invalid", ""),
        ("commands/none/arm", "{}".into(), "command_unknown", ""),
        ("commands/none/send", "{}".into(), "command_unknown", ""),
        ("commands/none/cancel", "{}".into(), "command_unknown", ""),
        ("estop/release", "{}".into(), "estop_not_in_force", ""),
        ("estop/release", "{\"tokn\":1}".into(), "unknown_field", "tokn"),
        ("terrain/imports", "{}".into(), "terrain_ambiguous", "file"),
        ("terrain/imports", "{\"file\":\"../x.tif\"}".into(), "file_name_invalid", ""),
        ("terrain/imports", "{\"recipe\":{\"name\":\"boulder_field\"},\"crop\":{\"width_m\":1}}".into(), "terrain_ambiguous", "crop"),
        ("terrain/imports", "{\"file\":\"a.tif\",\"crop\":{\"width_m\":0}}".into(), "out_of_range", "crop.width_m"),
        ("terrain/imports", "{\"file\":\"a.ply\",\"cell_m\":0}".into(), "out_of_range", "cell_m"),
        ("terrain/imports", "{\"recipe\":{\"name\":\"boulder_field\"},\"cell_m\":1}".into(), "terrain_ambiguous", "cell_m"),
        ("terrain/imports", "{\"recipe\":{\"name\":\"boulder_field\"},\"heading_rad\":1e9}".into(), "out_of_range", "heading_rad"),
        ("rover/cameras/coverage", "{}".into(), "missing_field", ""),
        ("rover/cameras/coverage", "{\"cameras\":[]}".into(), "empty", "cameras"),
        ("rover/cameras/coverage", "{\"cameras\":[\"nav1\",\"eye\"]}".into(), "camera_unknown", "cameras[1]"),
        ("rover/cameras/coverage", "{\"cameras\":[\"nav1\"],\"resolution_m\":0}".into(), "out_of_range", "resolution_m"),
        ("rover/cameras/coverage", "{\"cameras\":[\"nav1\"],\"scale\":2}".into(), "out_of_range", "scale"),
        ("terrain/reconstructions", "{}".into(), "empty", "cameras"),
        ("terrain/reconstructions", "{\"images\":[\"a/nav1\"]}".into(), "image_unknown", "images[0]"),
        ("terrain/reconstructions", "{\"images\":[\"nav1\"]}".into(), "image_unknown", "images[0]"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"depth_bits\":3}".into(), "out_of_range", "order.depth_bits"),
        ("terrain/reconstructions", "{\"cameras\":[]}".into(), "empty", "cameras"),
        ("terrain/reconstructions", "{\"cameras\":\"nav1\"}".into(), "wrong_type", "cameras"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav0\"]}".into(), "camera_unknown", "cameras[0]"),
        ("terrain/reconstructions", format!("{{\"cameras\":[{}]}}", many(17, "\"nav1\"")), "too_many", "cameras"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"scale\":0.1}".into(), "out_of_range", "scale"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"scale\":NaN}".into(), "not_finite", "scale"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"resolution_m\":0.001}".into(), "out_of_range", "resolution_m"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"seed\":-1}".into(), "wrong_type", "seed"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"scales\":{\"nav2\":0.5}}".into(), "camera_unknown", "scales"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"scales\":{\"nav1\":2}}".into(), "out_of_range", "scales.nav1"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"region\":{\"center_m\":[0,1e9],\"radius_m\":2}}".into(), "out_of_range", "region.center_m[1]"),
        ("terrain/reconstructions", "{\"cameras\":[\"nav1\"],\"region\":{\"center_m\":[0,0],\"radius_m\":0.1}}".into(), "out_of_range", "region.radius_m"),
        ("terrain/restore", "{\"log\":\"../x\"}".into(), "log_unknown", ""),
        ("terrain/restore", "{\"log\":3}".into(), "wrong_type", "log"),
        ("terrain/restore", "{}".into(), "missing_field", ""),
        ("replays", "{\"log\":\"../x\",\"rate\":1}".into(), "log_unknown", ""),
        ("replays", "{\"log\":\"x\",\"rate\":0}".into(), "rate_invalid", ""),
        ("replays", "{\"log\":\"x\",\"from\":\"yesterday\"}".into(), "wrong_type", "from"),
        ("logs/none/clips", "{}".into(), "log_unknown", ""),
        ("logs/none/clips", "{\"from\":1}".into(), "wrong_type", "from"),
        ("logs/none/clips", "{\"until\":1}".into(), "unknown_field", "until"),
        ("logs/none/bookmarks", "{\"at\":\"2026-01-01T00:00:00Z\",\"text\":\"x\"}".into(), "log_unknown", ""),
        ("logs/none/bookmarks", "{\"text\":\"x\"}".into(), "missing_field", ""),
    ]
}

#[tokio::test]
async fn every_bad_request_is_refused_by_its_name() {
    let ground = Ground::start().await;
    let mut wrong = Vec::new();
    for (route, body, code, field) in cases() {
        let request = Request::post(format!("/api/v1/{route}"))
            .header("content-type", "application/json")
            .body(Body::from(body.clone()))
            .unwrap();
        let answer = ground.send(request).await;
        let error = &answer.json()["error"];
        let found = (error["code"].as_str(), error["details"]["field"].as_str().unwrap_or(""));
        let shown: String = body.chars().take(120).collect();
        if found != (Some(code), field) || answer.status.is_success() {
            wrong.push(format!(
                "{route} {shown}\n    {} {error}\n    expected {code} {field:?}",
                answer.status
            ));
        }
        let message = error["message"].as_str().unwrap_or_default();
        if message.len() < 10 || message.len() > 600 {
            wrong.push(format!("{route} {shown}: the message {message:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}\n{} of them", wrong.join("\n"), wrong.len());
}

#[tokio::test]
async fn bodies_are_bounded_and_must_say_what_they_are() {
    let ground = Ground::start().await;
    let request = Request::post("/api/v1/analysis/kinematics").body(Body::from("{}")).unwrap();
    let answer = ground.send(request).await;
    assert_eq!((answer.status.as_u16(), answer.code().as_str()), (415, "content_type"));
    let large = format!("{{\"leg\":\"{}\"}}", "x".repeat(1 << 20));
    let answer = ground.post("plans", &Value::from(large)).await;
    assert_eq!((answer.status.as_u16(), answer.code().as_str()), (413, "body_too_large"));
    let named = Request::get("/api/v1/rover").header("x-operator", "x".repeat(65));
    assert_eq!(ground.send(named.body(Body::empty()).unwrap()).await.status, 200);
    let named = Request::put("/api/v1/link")
        .header("x-operator", "x".repeat(65))
        .header("content-type", "application/json")
        .body(Body::from(json!({ "up_delay_s": 0, "down_delay_s": 0 }).to_string()));
    assert_eq!(ground.send(named.unwrap()).await.code(), "operator_invalid");
}
