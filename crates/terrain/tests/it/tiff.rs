//! A minimal TIFF encoder of the tests' own, so that the reader is not checked against the writer.

/// A little-endian, single-strip, uncompressed TIFF of 32-bit floats, with tags to choose.
pub struct Tiff {
    pub width: u32,
    pub height: u32,
    pub bands: u16,
    /// (sample format, bits) of the SampleFormat and BitsPerSample tags.
    pub format: (u16, u16),
    pub pixels: Vec<u8>,
    pub pixel_scale: Option<Vec<f64>>,
    pub tie_point: Option<Vec<f64>>,
    pub transformation: Option<Vec<f64>>,
    /// (id, value) of short GeoKeys.
    pub keys: Vec<(u16, u16)>,
    pub nodata: Option<&'static str>,
    pub gdal_metadata: Option<&'static str>,
}

impl Tiff {
    /// Float32 rows, north first, upper left corner at (100, 200), pixels of 2 m.
    pub fn new(width: u32, rows: &[f32]) -> Tiff {
        Tiff {
            width,
            height: rows.len() as u32 / width,
            bands: 1,
            format: (3, 32),
            pixels: rows.iter().flat_map(|z| z.to_le_bytes()).collect(),
            pixel_scale: Some(vec![2.0, 2.0, 0.0]),
            tie_point: Some(vec![0.0, 0.0, 0.0, 100.0, 200.0, 0.0]),
            transformation: None,
            keys: vec![(1024, 1), (1025, 1), (3072, 32767), (3076, 9001)],
            nodata: None,
            gdal_metadata: None,
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        const SHORT: u16 = 3;
        const LONG: u16 = 4;
        const ASCII: u16 = 2;
        const DOUBLE: u16 = 12;
        let short = |v: u16| (SHORT, 1, v.to_le_bytes().to_vec());
        let long = |v: u32| (LONG, 1, v.to_le_bytes().to_vec());
        let doubles = |v: &[f64]| {
            (DOUBLE, v.len() as u32, v.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>())
        };
        let shorts = |v: &[u16]| {
            (SHORT, v.len() as u32, v.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>())
        };
        let ascii = |v: &str| (ASCII, v.len() as u32 + 1, [v.as_bytes(), &[0]].concat());
        let per_band = |v: u16| vec![v; usize::from(self.bands)];
        let mut entries = vec![
            (256, long(self.width)),
            (257, long(self.height)),
            (258, shorts(&per_band(self.format.1))),
            (259, short(1)),
            (262, short(1)),
            (273, long(8)),
            (277, short(self.bands)),
            (278, long(self.height)),
            (279, long(self.pixels.len() as u32)),
            (284, short(1)),
            (339, shorts(&per_band(self.format.0))),
        ];
        let optional = [(33550, &self.pixel_scale), (33922, &self.tie_point)];
        for (tag, values) in optional {
            entries.extend(values.as_ref().map(|v| (tag, doubles(v))));
        }
        entries.extend(self.transformation.as_ref().map(|v| (34264, doubles(v))));
        let mut directory = vec![1, 1, 0, self.keys.len() as u16];
        directory.extend(self.keys.iter().flat_map(|(id, value)| [*id, 0, 1, *value]));
        entries.push((34735, shorts(&directory)));
        entries.extend(self.gdal_metadata.map(|v| (42112, ascii(v))));
        entries.extend(self.nodata.map(|v| (42113, ascii(v))));

        let ifd_at = 8 + self.pixels.len();
        let mut data_at = ifd_at + 2 + 12 * entries.len() + 4;
        let mut out = b"II\x2a\0".to_vec();
        out.extend((ifd_at as u32).to_le_bytes());
        out.extend(&self.pixels);
        out.extend((entries.len() as u16).to_le_bytes());
        let mut data = Vec::new();
        for (tag, (kind, count, mut bytes)) in entries {
            out.extend(u16::to_le_bytes(tag));
            out.extend(kind.to_le_bytes());
            out.extend(u32::to_le_bytes(count));
            if bytes.len() <= 4 {
                bytes.resize(4, 0);
                out.extend(bytes);
            } else {
                out.extend((data_at as u32).to_le_bytes());
                data_at += bytes.len();
                data.extend(bytes);
            }
        }
        out.extend([0; 4]);
        out.extend(data);
        out
    }
}
