//! What a robot's folder may not hold, each refused by name.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{ModelError, Payload, Robot};

use crate::athlete;

fn load(
    change_toml: impl Fn(String) -> String,
    change_urdf: impl Fn(String) -> String,
) -> Result<Robot, ModelError> {
    let toml = change_toml(testkit::fixture_text("robots/athlete/robot.toml"));
    let urdf = change_urdf(testkit::fixture_text("robots/athlete/athlete.urdf"));
    Robot::from_folder(&toml, |_| Some(urdf), |_| None)
}

#[track_caller]
fn refused(change_urdf: impl Fn(String) -> String, word: &str) {
    let error = load(|t| t, change_urdf).expect_err("must be refused");
    assert!(error.to_string().contains(word), "{error} does not say {word:?}");
}

#[track_caller]
fn refused_toml(from: &str, to: &str, word: &str) {
    let original = testkit::fixture_text("robots/athlete/robot.toml");
    assert!(original.contains(from), "the fixture has no {from:?}");
    let error = load(|t| t.replacen(from, to, 1), |u| u).expect_err("must be refused");
    assert!(error.to_string().contains(word), "{error} does not say {word:?}");
}

#[test]
fn hostile_urdfs_are_refused_by_name() {
    let first_box = r#"<box size="2.598 1.5 0.237"/>"#;
    let mesh = |name: &str| format!(r#"<mesh filename="{name}"/>"#);
    refused(|u| u.replace(first_box, &mesh("gone.stl")), "gone.stl");
    refused(|u| u.replace(first_box, &mesh("gone.stl")), "not in the robot");
    for outside in [
        "/etc/passwd",
        "../x.stl",
        "a/../../x.stl",
        "package://",
        "package://x",
        "",
        "package://x/../y.stl",
        "file:///x.stl",
        "C:\\x.stl",
        "a//b.stl",
    ] {
        refused(|u| u.replace(first_box, &mesh(outside)), "relative path");
    }
    refused(|u| u.replacen("?>", "?><!DOCTYPE robot [<!ENTITY a \"b\">]>", 1), "document type");
    refused(
        |u| u.replacen("<robot", "<!ENTITY x SYSTEM \"file:///etc/passwd\"><robot", 1),
        "entity",
    );
    refused(|u| u.replacen("0.552 0 0", "0.552 NaN 0", 1), "finite");
    refused(|u| u.replacen("0.552 0 0", "0.552 inf 0", 1), "finite");
    refused(|u| u.replacen(r#"mass value=""#, r#"mass value="-"#, 1), "negative mass");
    refused(|u| u.replacen(r#"radius="0.264""#, r#"radius="0""#, 1), "size that is zero");
    refused(|u| u.replacen(r#"<axis xyz="0 0 1"/>"#, r#"<axis xyz="0 0 0"/>"#, 1), "no axis");
    refused(|u| u.replacen("revolute", "floating", 1), "neither fixed");
    refused(|u| u.replacen("leg1_hip_yaw_link", "nobody", 1), "no link");
    refused(|u| u.replacen("<robot", "<rowboat", 1), "cannot be read");
    refused(|_| String::new(), "cannot be read");
    refused(|u| u[..u.len() / 2].to_string(), "cannot be read");
}

#[test]
fn a_cycle_is_refused() {
    let cycle = r#"<link name="a"/><link name="b"/>
        <joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
        <joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"#;
    refused(|u| u.replace("</robot>", cycle), "cycle");
    let back = r#"<joint name="back" type="fixed"><parent link="leg1_wheel_link"/>
        <child link="chassis"/></joint></robot>"#;
    refused(|u| u.replace("</robot>", back), "base link is the child");
    let second = r#"<joint name="again" type="fixed"><parent link="chassis"/>
        <child link="leg1_wheel_link"/></joint></robot>"#;
    refused(|u| u.replace("</robot>", second), "two parent");
}

#[test]
fn a_million_links_are_refused_before_they_are_read() {
    let many = "<link name=\"x\"/>".repeat(1_000_000);
    refused(|u| u.replace("</robot>", &format!("{many}</robot>")), "limit");
    let fewer = "<link name=\"x\"/>".repeat(3_000);
    refused(|u| u.replace("</robot>", &format!("{fewer}</robot>")), "links");
}

#[test]
fn a_long_chain_is_read_without_recursion() {
    let mut chain = String::new();
    for i in 0..1_900 {
        let parent = if i == 0 { "chassis".into() } else { format!("c{}", i - 1) };
        chain += &format!(
            r#"<link name="c{i}"/><joint name="j{i}" type="fixed"><parent link="{parent}"/><child link="c{i}"/></joint>"#
        );
    }
    let robot = load(|t| t, |u| u.replace("</robot>", &format!("{chain}</robot>"))).unwrap();
    assert_eq!(robot.links().len(), 43 + 1_900);
}

#[test]
fn a_bad_robot_toml_is_refused_by_field() {
    refused_toml("wheel_radius_m = 0.264", "wheel_radius_m = -1.0", "wheel_radius_m");
    refused_toml("wheel_radius_m = 0.264", "wheel_radius_m = nan", "wheel_radius_m");
    refused_toml("joint_speed_rad_s = 0.1 ", "joint_speed_rad_s = 0.0 ", "joint_speed_rad_s");
    refused_toml("margin_m = 0.15", "margin_m = -0.15", "margin_m");
    refused_toml("margin_m = 0.15", "margine_m = 0.15", "margine_m");
    refused_toml("\"leg1_hip_pitch\", ", "", "does not hang on");
    refused_toml(", \"leg1_ankle_roll\"]", "]", "wheel joint");
    refused_toml("wheel_width_m = 0.24\n", "", "wheel_width_m");
    refused_toml(
        "wheel_width_m = 0.24\n",
        "wheel_width_m = 0.24\nfoot_radius_m = 0.1\n",
        "foot_link",
    );
    refused_toml("leg1_hip_pitch", "leg2_hip_pitch", "does not hang on");
    refused_toml("wheel_joint = \"leg1_wheel\"", "wheel_joint = \"leg2_wheel\"", "wheel joint");
    refused_toml("name = \"leg2\"", "name = \"leg1\"", "twice");
    refused_toml("base_link = \"chassis\"", "base_link = \"hull\"", "hull");
}

#[test]
fn payloads_are_checked() {
    let robot = athlete();
    let good = Payload {
        link: "chassis".into(),
        mass: 10.0,
        com: nalgebra::Point3::origin(),
        shapes: Vec::new(),
        limits: Vec::new(),
    };
    assert!(robot.with_payloads(std::slice::from_ref(&good)).is_ok());
    let heavy = Payload { mass: f64::INFINITY, ..good.clone() };
    assert!(robot.with_payloads(&[heavy]).unwrap_err().to_string().contains("mass_kg"));
    let nowhere = Payload { link: "deck".into(), ..good.clone() };
    assert!(robot.with_payloads(&[nowhere]).unwrap_err().to_string().contains("deck"));
    let edges = nalgebra::Vector3::new(1.0, 0.0, 1.0);
    let flat = Payload::boxed("chassis", 10.0, good.com, edges);
    assert_eq!(robot.with_payloads(&[flat]), Err(ModelError::PayloadShape));
}

#[test]
fn no_mutation_of_a_urdf_makes_it_panic() {
    // The quadruped cut down to its trunk and one leg: short, and with all that a URDF has.
    let text = |file: &str| testkit::fixture_text(&format!("robots/quadruped/{file}"));
    let mesh = text("meshes/trunk.obj");
    let toml = text("robot.toml");
    let toml = &toml[..toml.match_indices("[[legs]]").nth(1).expect("more legs").0];
    let urdf = text("quadruped.urdf");
    let one_leg = &urdf[..urdf.find("  <link name=\"FR_hip\">").expect("a second leg")];
    let urdf = format!("{one_leg}</robot>").into_bytes();
    let words = ["0", "-1e308", "NaN", "<link name=\"a\"/>", "\"", ">", "prismatic", "</joint>"];
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let mut loaded = 0;
    for _ in 0..10_000 {
        let mut bytes = urdf.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            match rng.random_range(0..3) {
                0 => bytes[at] = rng.random_range(b' '..=b'~'),
                1 => drop(bytes.drain(at..(at + rng.random_range(0..60)).min(bytes.len()))),
                _ => {
                    let word = words[rng.random_range(0..words.len())];
                    bytes.splice(at..at, word.bytes());
                }
            }
        }
        let urdf = String::from_utf8_lossy(&bytes).into_owned();
        let mesh = |_: &str| Some(mesh.clone().into_bytes());
        loaded += usize::from(Robot::from_folder(toml, |_| Some(urdf), mesh).is_ok());
    }
    assert!(loaded > 100, "only {loaded} of 10 000 were still robots: no evidence");
}

#[test]
fn a_long_line_is_no_reason_for_a_long_message() {
    let long = format!("name = \"a\"\nurdf = \"{}\nbase_link = \"b\"\n", "x".repeat(10_000));
    let error = load(|_| long.clone(), |u| u).expect_err("must be refused").to_string();
    assert!(error.len() < 1000 && error.contains("line 2"), "{error}");
}
