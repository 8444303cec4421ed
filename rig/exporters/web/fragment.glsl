#version 300 es
precision highp float;
precision highp sampler3D;

in vec2 place;           // of the pixel, -1 to 1
out vec4 shown;

uniform sampler3D voxels;   // amplitude, 0 to 1
uniform sampler2D colours;  // a row for each table
uniform float table;        // which row, its middle
uniform bool byDepth, surface, onBlack;
uniform vec2 half_m;        // half of what the canvas shows [m]
uniform vec3 middle_m, right, up, away;  // the camera: parallel light, so that a length is the same anywhere
uniform vec3 low_m, high_m, pitch_m;     // edges of the voxels, and their sides
uniform vec2 cut_m, colours_m;           // depths that are shown; depths of the ends of the colours
uniform float threshold;

float at(vec3 p) { return texture(voxels, (p - low_m) / (high_m - low_m)).r; }

vec3 colour(float z_m, float amplitude) {
  float along = byDepth ? (z_m - colours_m.x) / (colours_m.y - colours_m.x) : amplitude;
  return texture(colours, vec2(clamp(along, 0.002, 0.998), table)).rgb;
}

void main() {
  vec3 ground = vec3(onBlack ? 0.0 : 1.0);
  vec3 from = middle_m + place.x * half_m.x * right + place.y * half_m.y * up;
  vec3 low = vec3(low_m.xy, max(low_m.z, cut_m.x)), high = vec3(high_m.xy, min(high_m.z, cut_m.y));
  vec3 along = away + vec3(equal(away, vec3(0.0))) * 1e-6;
  vec3 one = (low - from) / along, other = (high - from) / along;
  vec3 first = min(one, other), last = max(one, other);
  float enter = max(max(first.x, first.y), first.z), leave = min(min(last.x, last.y), last.z);
  shown = vec4(ground, 1.0);
  if (enter >= leave) return;

  float stride = 0.5 * min(pitch_m.x, min(pitch_m.y, pitch_m.z));
  int steps = int(min(ceil((leave - enter) / stride), 1500.0));
  stride = (leave - enter) / float(steps);
  float greatest = 0.0, where = enter;
  for (int i = 0; i <= steps; i++) {
    float s = enter + float(i) * stride, value = at(from + s * along);
    if (value > greatest) { greatest = value; where = s; }
    if (surface && value >= threshold) {
      float before = s - stride, behind = s;
      for (int k = 0; k < 6; k++) {
        float half_way = 0.5 * (before + behind);
        if (at(from + half_way * along) >= threshold) behind = half_way; else before = half_way;
      }
      vec3 p = from + max(behind, enter) * along;
      vec3 d = pitch_m;
      vec3 slope = vec3(at(p + vec3(d.x, 0, 0)) - at(p - vec3(d.x, 0, 0)),
                        at(p + vec3(0, d.y, 0)) - at(p - vec3(0, d.y, 0)),
                        at(p + vec3(0, 0, d.z)) - at(p - vec3(0, 0, d.z))) / d;
      vec3 normal = -normalize(slope + 1e-6 * along);
      float facing = abs(dot(normal, normalize(0.35 * right + 0.5 * up - away)));
      shown = vec4(colour(p.z, at(p)) * (0.55 + 0.45 * facing), 1.0);
      return;
    }
  }
  if (surface || greatest <= 0.0) return;
  float seen = smoothstep(0.5 * threshold, threshold, greatest);
  shown = vec4(mix(ground, colour((from + where * along).z, greatest), seen), 1.0);
}
