// Screen-space hatching of materials: marks what is not certainly so, as old or predicted poses.

import type { Material, WebGLProgramParametersWithUniforms } from "three";

export interface HatchUniform {
  /** 0 is plain, 1 is hatched and dimmed. */
  value: number;
}

/** Makes `material` hatch by `amount`, which materials can share. */
export function hatchable<M extends Material>(material: M, amount: HatchUniform): M {
  material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
    shader.uniforms.uHatch = amount;
    shader.fragmentShader = shader.fragmentShader
      .replace("void main() {", "uniform float uHatch;\nvoid main() {")
      .replace(
        "#include <opaque_fragment>",
        `#include <opaque_fragment>
         float stripe = step(0.5, fract((gl_FragCoord.x + gl_FragCoord.y) / 9.0));
         vec3 dim = mix(gl_FragColor.rgb, vec3(dot(gl_FragColor.rgb, vec3(0.33))), 0.7) * 0.6;
         gl_FragColor.rgb = mix(gl_FragColor.rgb, dim * (0.45 + 0.55 * stripe), uHatch);`,
      );
  };
  material.customProgramCacheKey = () => "hatchable";
  return material;
}
