#version 300 es
// Two triangles that cover the canvas; each pixel then looks along its own line of sight.
out vec2 place;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  place = 2.0 * corner - 1.0;
  gl_Position = vec4(place, 0.0, 1.0);
}
