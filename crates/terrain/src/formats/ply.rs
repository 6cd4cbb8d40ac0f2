//! PLY (Stanford polygon format 1.0): points in, meshes out; ASCII and binary of either byte order.
//!
//! Of a file the x, y and z of the element `vertex` are read, as meters, z up; other properties and
//! elements are passed over. Points with a coordinate that is NaN are left out, as scanners write them
//! for pixels without an answer.

use nalgebra::Point3;

use super::mesh::HeightMesh;
use crate::TerrainError;

/// Longest header (bytes).
const HEADER_MAX: usize = 1 << 16;
/// Most elements and properties of a header.
const DECLARATIONS_MAX: usize = 256;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

enum Property {
    Scalar(String, Scalar),
    List(Scalar, Scalar),
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

fn refuse(place: impl ToString, reason: impl ToString) -> TerrainError {
    let place = place.to_string().chars().take(60).collect();
    TerrainError::Ply { place, reason: reason.to_string() }
}

/// The points of a file; one with more than `max_points` is refused before memory is taken for them.
pub fn read_points(bytes: &[u8], max_points: usize) -> Result<Vec<Point3<f64>>, TerrainError> {
    let (encoding, elements, body) = header(bytes)?;
    let mut values = Values { encoding, rest: &bytes[body..] };
    for element in &elements {
        if element.name == "vertex" {
            return vertices(element, &mut values, max_points);
        }
        // What comes before is passed over; nothing is kept of it.
        for i in 0..element.count {
            let place = || format!("element {} {i}", element.name);
            for property in &element.properties {
                property.pass_over(&mut values).ok_or_else(|| refuse(place(), TRUNCATED))?;
            }
            if element.properties.is_empty() {
                return Err(refuse(place(), "has no properties"));
            }
        }
    }
    Err(refuse("header", "has no element vertex: no points"))
}

const TRUNCATED: &str = "is cut off or no number: the file is truncated or damaged";

fn vertices(
    element: &Element,
    values: &mut Values,
    max_points: usize,
) -> Result<Vec<Point3<f64>>, TerrainError> {
    let axis = |wanted: &str| {
        let is_it = |p: &Property| matches!(p, Property::Scalar(name, _) if name == wanted);
        let missing = || refuse("element vertex", format!("has no property {wanted}"));
        element.properties.iter().position(is_it).ok_or_else(missing)
    };
    let [x, y, z] = [axis("x")?, axis("y")?, axis("z")?];
    TerrainError::check("number of points", element.count as f64, [0.0, max_points as f64], {
        "as many points as are allowed: thin the cloud out or crop it"
    })?;
    let shortest = |property: &Property| match property {
        Property::Scalar(_, kind) | Property::List(kind, _) => kind.size() as u64,
    };
    let per_vertex: u64 = match values.encoding {
        Encoding::Ascii => 2 * element.properties.len() as u64,
        _ => element.properties.iter().map(shortest).sum(),
    };
    let fits = values.rest.len() as u64 + 1;
    if element.count.saturating_mul(per_vertex) > fits {
        let text = format!("are {}, more than the file holds: it is truncated", element.count);
        return Err(refuse("element vertex", text));
    }
    let mut points = Vec::with_capacity(element.count as usize);
    for i in 0..element.count {
        let mut position = [0.0; 3];
        for (k, property) in element.properties.iter().enumerate() {
            let place = || format!("vertex {i}");
            let truncated = || refuse(place(), TRUNCATED);
            let Property::Scalar(_, kind) = property else {
                property.pass_over(values).ok_or_else(truncated)?;
                continue;
            };
            let value = values.next(*kind).ok_or_else(truncated)?;
            for (axis, place) in [x, y, z].into_iter().enumerate() {
                if k == place {
                    position[axis] = value;
                }
            }
        }
        if position.iter().any(|v| v.is_infinite()) {
            return Err(refuse(format!("vertex {i}"), "has an infinite coordinate"));
        }
        if !position.iter().any(|v| v.is_nan()) {
            points.push(Point3::from(position));
        }
    }
    Ok(points)
}

impl Property {
    fn pass_over(&self, values: &mut Values) -> Option<()> {
        match self {
            Property::Scalar(_, kind) => values.next(*kind).map(drop),
            Property::List(count, kind) => {
                let n = values.next(*count).filter(|n| (0.0..=1e9).contains(n))?;
                (0..n as u64).try_for_each(|_| values.next(*kind).map(drop))
            }
        }
    }
}

impl Scalar {
    fn of(name: &str) -> Option<Scalar> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }
}

/// The values of the body, one after the other.
struct Values<'a> {
    encoding: Encoding,
    rest: &'a [u8],
}

impl Values<'_> {
    fn next(&mut self, kind: Scalar) -> Option<f64> {
        if self.encoding == Encoding::Ascii {
            let start = self.rest.iter().position(|b| !b.is_ascii_whitespace())?;
            let rest = &self.rest[start..];
            let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
            self.rest = &rest[end..];
            return std::str::from_utf8(&rest[..end]).ok()?.parse().ok();
        }
        let (bytes, rest) = self.rest.split_at_checked(kind.size())?;
        self.rest = rest;
        let mut little = [0; 8];
        little[..bytes.len()].copy_from_slice(bytes);
        if self.encoding == Encoding::Big {
            little[..bytes.len()].reverse();
        }
        let bits = u64::from_le_bytes(little);
        Some(match kind {
            Scalar::I8 => f64::from(bits as i8),
            Scalar::U8 | Scalar::U16 | Scalar::U32 => bits as f64,
            Scalar::I16 => f64::from(bits as i16),
            Scalar::I32 => f64::from(bits as i32),
            Scalar::F32 => f64::from(f32::from_bits(bits as u32)),
            Scalar::F64 => f64::from_bits(bits),
        })
    }
}

/// Encoding, elements, and where the body begins.
fn header(bytes: &[u8]) -> Result<(Encoding, Vec<Element>, usize), TerrainError> {
    let head = &bytes[..bytes.len().min(HEADER_MAX)];
    let mut start = 0;
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut n_declared = 0;
    for number in 1.. {
        let place = format!("header line {number}");
        let Some(length) = head[start..].iter().position(|b| *b == b'\n') else {
            return Err(refuse(place, "is not followed by end_header"));
        };
        let line = String::from_utf8_lossy(&head[start..start + length]);
        start += length + 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        n_declared += 1;
        if n_declared > DECLARATIONS_MAX {
            return Err(refuse(place, format!("is beyond the {DECLARATIONS_MAX} allowed")));
        }
        match words.as_slice() {
            ["ply"] if number == 1 => {}
            _ if number == 1 => return Err(refuse(place, "is not `ply`: no PLY file")),
            ["format", name, "1.0"] => {
                encoding = Some(match *name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => return Err(refuse(place, "has an unknown format")),
                });
            }
            ["comment" | "obj_info", ..] | [] => {}
            ["element", name, count] => {
                let count = count.parse().map_err(|_| refuse(&place, "has no whole number"))?;
                elements.push(Element { name: (*name).into(), count, properties: Vec::new() });
            }
            ["property", rest @ ..] => {
                let unknown = || refuse(&place, "has an unknown type");
                let property = match rest {
                    ["list", count, kind, _] => {
                        let [count, kind] = [count, kind].map(|name| Scalar::of(name));
                        Property::List(count.ok_or_else(unknown)?, kind.ok_or_else(unknown)?)
                    }
                    [kind, name] => {
                        Property::Scalar((*name).into(), Scalar::of(kind).ok_or_else(unknown)?)
                    }
                    _ => return Err(refuse(&place, "is no property")),
                };
                let Some(element) = elements.last_mut() else {
                    return Err(refuse(&place, "comes before any element"));
                };
                element.properties.push(property);
            }
            ["end_header"] => break,
            _ => return Err(refuse(place, "is unknown")),
        }
    }
    let encoding = encoding.ok_or_else(|| refuse("header", "has no format 1.0"))?;
    Ok((encoding, elements, start))
}

/// A mesh as binary little-endian PLY; `comments` go into its header, a line each.
pub fn write(mesh: &HeightMesh, comments: &[String]) -> Vec<u8> {
    let mut header = "ply\nformat binary_little_endian 1.0\n".to_owned();
    for comment in comments {
        header += &format!("comment {}\n", comment.replace(['\n', '\r'], " "));
    }
    header += &format!(
        "element vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.triangles.len()
    );
    let mut bytes = header.into_bytes();
    bytes.reserve(24 * mesh.vertices.len() + 13 * mesh.triangles.len());
    for vertex in &mesh.vertices {
        bytes.extend(vertex.iter().flat_map(|v| v.to_le_bytes()));
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|i| i.to_le_bytes()));
    }
    bytes
}
