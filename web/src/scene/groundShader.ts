// What the ground's material adds to three's Lambert shader.

export const GROUND_VERTEX = "vGround = position.xy;";

export const GROUND_PARS = /* glsl */ `
varying vec2 vGround;
uniform sampler2D uRelief;
uniform vec2 uOrigin;
uniform vec2 uExtent;
uniform vec2 uReliefNodes;
uniform sampler2D uPicture;
uniform vec2 uPictureOrigin;
uniform vec2 uPictureExtent;
uniform float uPictureOn;
uniform sampler2D uRaster;
uniform vec2 uRasterOrigin;
uniform vec2 uRasterExtent;
uniform float uRasterOn;
uniform sampler2D uClasses;
uniform vec2 uOverlayOrigin;
uniform vec2 uOverlayNodes;
uniform float uOverlayStep;
uniform float uOverlayOn;
uniform vec3 uOverlayCircle;
uniform vec3 uStyles[12];
uniform float uStrengths[12];
uniform float uHatches[12];

vec4 reliefAt(vec2 place) {
  vec2 share = (place - uOrigin) / uExtent;
  return texture2D(uRelief, (share * (uReliefNodes - 1.0) + 0.5) / uReliefNodes);
}

// Color and strength of a picture at a place; nothing beside it.
vec4 drapeAt(sampler2D image, vec2 origin, vec2 extent, vec2 place) {
  vec2 share = (place - origin) / extent;
  if (any(lessThan(share, vec2(0.0))) || any(greaterThan(share, vec2(1.0)))) return vec4(0.0);
  vec4 texel = texture2D(image, share);
  // Transparent texels are black; what they mix into their neighbors is taken out again.
  return vec4(texel.rgb / max(texel.a, 1e-3), texel.a);
}

// A line of the given share of its period, smoothed over a pixel.
float stripe(float position, float share) {
  float w = fwidth(position);
  float d = abs(fract(position) - 0.5);
  return (1.0 - smoothstep(0.5 * share - w, 0.5 * share + w, d)) * clamp(1.0 - 1.5 * w, 0.0, 1.0);
}

// Strength of the hatching at a place; 10 lines a meter at most.
float hatching(float kind, vec2 p) {
  if (kind < 0.5) return 0.0;
  if (kind < 1.5) return stripe((p.x + p.y) * 3.0, 0.3);
  if (kind < 2.5) return stripe((p.x - p.y) * 3.0, 0.3);
  if (kind < 3.5) return max(stripe((p.x + p.y) * 3.5, 0.22), stripe((p.x - p.y) * 3.5, 0.22));
  if (kind < 4.5) return stripe(p.y * 5.0, 0.3);
  if (kind < 5.5) return stripe(p.x * 5.0, 0.42) * stripe(p.y * 5.0, 0.42);
  return stripe(p.x * 5.0, 0.3);
}

float gridLine(vec2 p) {
  vec2 w = fwidth(p);
  vec2 d = abs(fract(p - 0.5) - 0.5) / max(w, vec2(1e-6));
  float line = 1.0 - min(min(d.x, d.y), 1.0);
  return line * clamp(1.0 - 6.0 * max(w.x, w.y), 0.0, 1.0);
}
`;

export const GROUND_COLOR = /* glsl */ `
vec4 relief = reliefAt(vGround);
float bulge = relief.b * 2.0 - 1.0;
float grain = fract(sin(dot(floor(vGround * 24.0), vec2(12.9898, 78.233))) * 43758.5453);
vec3 dust = vec3(0.36, 0.345, 0.325) * (1.0 + 0.55 * bulge) * (0.97 + 0.06 * grain);
dust = mix(dust, vec3(0.52, 0.56, 0.6), 0.10 * gridLine(vGround));
dust = mix(dust, vec3(0.52, 0.56, 0.6), 0.16 * gridLine(vGround / 5.0));
float unknown = 1.0 - step(0.5, relief.a);
vec3 hidden = vec3(0.13, 0.15, 0.18) + 0.09 * hatching(1.0, vGround);
dust = mix(dust, hidden, unknown);
float flatness = 0.0;
if (uPictureOn > 0.5) {
  vec4 seen = drapeAt(uPicture, uPictureOrigin, uPictureExtent, vGround);
  // The sun is in the picture already: it is shown as level ground would be.
  flatness = seen.a * (1.0 - unknown);
  dust = mix(dust, seen.rgb, flatness);
}
if (uRasterOn > 0.0) {
  vec4 laid = drapeAt(uRaster, uRasterOrigin, uRasterExtent, vGround);
  dust = mix(dust, laid.rgb, laid.a * uRasterOn * (1.0 - unknown));
}
if (uOverlayOn > 0.5) {
  vec2 node = floor((vGround - uOverlayOrigin) / uOverlayStep + 0.5);
  vec2 place = uOverlayOrigin + node * uOverlayStep;
  bool within = uOverlayCircle.z <= 0.0 || distance(place, uOverlayCircle.xy) <= uOverlayCircle.z;
  if (within && all(greaterThanEqual(node, vec2(0.0))) && all(lessThan(node, uOverlayNodes))) {
    int kind = int(texture2D(uClasses, (node + 0.5) / uOverlayNodes).r * 255.0 + 0.5);
    vec3 tint = vec3(0.5);
    float strength = 0.0;
    float hatch = 0.0;
    for (int i = 0; i < 12; i++) {
      if (i == kind) {
        tint = uStyles[i];
        strength = uStrengths[i];
        hatch = uHatches[i];
      }
    }
    float shade = 0.85 + 0.5 * bulge;
    float lines = hatching(hatch, vGround);
    dust = mix(dust, tint * shade, strength * (1.0 - 0.25 * lines));
    dust = mix(dust, tint * 0.3, 0.75 * lines * strength);
  }
}
diffuseColor.rgb = dust;
`;

export const GROUND_NORMAL = /* glsl */ `
vec2 lean = (relief.rg * 2.0 - 1.0) * (1.0 - flatness);
vec3 upright = vec3(lean, sqrt(max(0.0, 1.0 - dot(lean, lean))));
normal = normalize((viewMatrix * vec4(upright, 0.0)).xyz);
`;
