// The picture: floor, sky and shadows, and bodies whose capsules are ray-cast on quads.

const ROW = 256; // capsules in a row of their texture, and in a batch
const LOOKS = {
  // As `crowdsim render` has them: light of sun, sky and floor, the floor's brightness and pattern, horizon and zenith.
  light: { floor: [0.40, 0.055, 0.34, 0.13], horizon: [0.66, 0.73, 0.81], zenith: [0.24, 0.37, 0.61] },
  dark: { floor: [0.10, 0.016, 0.40, 0.16], horizon: [0.07, 0.08, 0.10], zenith: [0.015, 0.018, 0.03] },
};
// Resolution, samples for smooth edges: from fine to fast. The first is for displays with small pixels.
const QUALITIES = [[2, 4], [1, 4], [1, 0], [0.7, 0], [0.5, 0], [0.35, 0]];
const SLOW = 42, FAST = 24; // medians of the time between pictures at which quality changes [ms]
const SWIFT = 20, HASTE = 2; // the median that is soon enough for what is dragged [ms]; how much coarser others begin, and twice that where it is twice as long

const COARSE = [1600, 560], FACE = [2, 3, 4, 5]; // triangles of coarse skins; parts of faces, which these have as skin

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform vec3 eye, ahead, right, up, sun, horizon;
uniform vec2 extent; // tangents of half the picture
uniform float pixel, haze; // width of a pixel at a distance of 1; distance at which haze hides half
const vec3 SUN = vec3(1.22, 1.19, 1.11), SKY = vec3(0.40, 0.45, 0.53), LOW = vec3(0.20, 0.20, 0.19);
vec4 project(vec3 p) {
  vec3 v = p - eye;
  float z = dot(v, ahead), near = 0.05, far = 5000.0;
  return vec4(dot(v, right) / extent.x, dot(v, up) / extent.y, (z * (far + near) - 2.0 * far * near) / (far - near), z);
}
float fog(float way) { float f = way / haze; f *= f; return f / (1.0 + f); }
vec3 develop(vec3 c) {
  c = max(c, 0.0);
  return sqrt(min(mix(c, 0.8 + (c - 0.8) / (1.0 + 2.0 * (c - 0.8)), step(0.8, c)), 1.0));
}
`;
const LIT = `
// How light is on a surface; what is below a body's middle and near the floor sees less of sky and floor: a point, its normal, the way to it, its paint, how far it is.
vec3 shade(vec3 p, vec3 n, vec3 way, vec4 paint, float hit) {
  float open = clamp(0.62 + 0.35 * p.y + 0.18 * n.y, 0.45, 1.0);
  float lit = max(dot(n, sun), 0.0), sky = open * (0.5 + 0.5 * n.y);
  float low = open * (0.5 - 0.5 * n.y) * min(0.35 + 0.8 * max(p.y, 0.0), 1.0);
  float shine = paint.a * min(2.0 * lit, 1.0) * pow(max(dot(normalize(sun - way), n), 0.0), 48.0);
  float rim = max(1.0 + dot(n, way), 0.0);
  rim = 0.35 * paint.a * sky * rim * rim * rim * rim;
  vec3 c = paint.rgb * (SUN * lit + SKY * sky + LOW * low) + shine + rim * vec3(0.8, 0.9, 1.0);
  return develop(mix(c, horizon, fog(hit)));
}
`;
const FETCH = `
uniform sampler2D shapes;
uniform int count;
int item() { return gl_InstanceID * ${ROW} + gl_VertexID / 4; }
vec2 corner() { int c = gl_VertexID & 3; return vec2(c == 1 || c == 2 ? 1.0 : -1.0, c > 1 ? 1.0 : -1.0); }
vec4 part(int i, int k) { return texelFetch(shapes, ivec2(i % ${ROW} * 3 + k, i / ${ROW}), 0); }
`;
const BODY_VERTEX = `${HEAD}${FETCH}
flat out vec4 a, b, paint;
out vec3 at;
void main() {
  int i = item();
  if (i >= count) { gl_Position = vec4(2, 2, 2, 1); return; }
  a = part(i, 0); b = part(i, 1); paint = part(i, 2);
  vec2 c = corner();
  float r = max(a.w, b.w);
  vec3 to = eye - 0.5 * (a.xyz + b.xyz);
  float away = length(to);
  vec3 w = to / away, along = b.xyz - a.xyz, x = cross(along, w);
  float wide = length(x);
  x = wide > 1e-5 ? x / wide : normalize(cross(vec3(0.3, 1.0, 0.2), w));
  vec3 y = cross(w, x);
  float side = dot(along, y) < 0.0 ? -1.0 : 1.0;
  vec4 end = c.y < 0.0 ? a : b;
  float grow = (1.0 + r / away) , edge = pixel * away;
  at = end.xyz + w * end.w + (x * c.x * (r + edge) + y * (c.y * side) * (end.w + edge)) * grow;
  gl_Position = project(at);
}`;
const BODY_FRAGMENT = `${HEAD}${LIT}
flat in vec4 a, b, paint;
in vec3 at;
out vec4 colour;
void main() {
  vec3 way = normalize(at - eye), ba = b.xyz - a.xyz, oa = eye - a.xyz;
  float ra = a.w, rb = b.w, taper = rb - ra;
  float bb = dot(ba, ba), bw = dot(ba, way), bo = dot(ba, oa), ow = dot(oa, way), oo = dot(oa, oa);
#ifdef SMOOTH
  // How far the ray misses the axis: edges are as smooth as that says.
  float s = clamp((bo - bw * ow) / max(bb - bw * bw, 1e-9), 0.0, 1.0);
  // Of a cone the widest place is nearer to its thicker end.
  float t = s * bw - ow;
  vec3 gap = oa + way * t - ba * s;
  float miss = length(gap);
  s = clamp(s + taper * miss / max(bb - bw * bw, 1e-6), 0.0, 1.0);
  t = s * bw - ow;
  gap = oa + way * t - ba * s;
  float outside = length(gap) - (ra + taper * s);
  float cover = clamp(0.5 - outside / (pixel * t), 0.0, 1.0);
  if (cover <= 0.0 || t < 0.03) discard;
  vec3 n = normalize(gap);
#else
  float cover = 1.0;
  vec3 n;
#endif
  float d2 = bb - taper * taper, k2 = d2 - bw * bw, k1 = d2 * ow - bo * bw - bw * taper * ra;
  float k0 = d2 * oo - bo * bo - bo * taper * ra * 2.0 - bb * ra * ra, h = k1 * k1 - k0 * k2, hit = -1.0;
  if (h > 0.0 && abs(k2) > 1e-9) {
    float u = (-sqrt(h) - k1) / k2, y = bo + ra * taper + u * bw;
    if (y > 0.0 && y < d2) { hit = u; n = normalize(d2 * (oa + u * way) - ba * y); }
  }
  if (hit < 0.0) {
    vec3 ob = eye - b.xyz;
    float wb = dot(ob, way), ha = ow * ow - oo + ra * ra, hb = wb * wb - dot(ob, ob) + rb * rb;
    float ta = ha > 0.0 ? -ow - sqrt(ha) : 1e9, tb = hb > 0.0 ? -wb - sqrt(hb) : 1e9;
    if (min(ta, tb) < 1e8) { hit = min(ta, tb); n = normalize(ta < tb ? oa + ta * way : ob + tb * way); }
  }
#ifdef SMOOTH
  if (hit < 0.0) hit = t;
#else
  if (hit < 0.03) discard;
#endif
  vec3 p = eye + hit * way;
  vec4 q = project(p);
  gl_FragDepth = 0.5 + 0.5 * q.z / q.w;
  colour = vec4(shade(p, n, way, paint, hit), cover);
}`;
const SKIN_VERTEX = `${HEAD}
layout(location = 0) in vec3 place;
layout(location = 1) in vec4 normal; // and the number of its part
layout(location = 2) in uvec4 joints;
layout(location = 3) in vec4 weights;
uniform sampler2D bones; // of each avatar a row: paints of its parts, then three texels a joint, which take the skin into the world
uniform int body; // row of the first avatar
out vec3 at, n;
flat out vec4 paint;
void main() {
  int row = body + gl_InstanceID;
  paint = texelFetch(bones, ivec2(int(127.0 * normal.w + 0.5), row), 0);
  vec4 x = vec4(0), y = vec4(0), z = vec4(0);
  for (int k = 0; k < 4; k++) {
    if (weights[k] == 0.0) continue;
    int j = 3 * int(joints[k]) + ${SKIN_PARTS};
    x += weights[k] * texelFetch(bones, ivec2(j, row), 0);
    y += weights[k] * texelFetch(bones, ivec2(j + 1, row), 0);
    z += weights[k] * texelFetch(bones, ivec2(j + 2, row), 0);
  }
  vec4 p = vec4(place, 1);
  at = vec3(dot(x, p), dot(y, p), dot(z, p));
  n = vec3(dot(x.xyz, normal.xyz), dot(y.xyz, normal.xyz), dot(z.xyz, normal.xyz));
  gl_Position = project(at);
}`;
const PROP_VERTEX = `${HEAD}
layout(location = 0) in vec3 place;
layout(location = 1) in vec3 normal;
uniform vec3 joint; // that carries it: its position and rotation
uniform vec4 turn;
uniform float size;
uniform vec4 colour;
out vec3 at, n;
flat out vec4 paint;
vec3 turned(vec3 v) { return v + 2.0 * cross(turn.yzw, cross(turn.yzw, v) + turn.x * v); }
void main() {
  at = joint + turned(size * place);
  n = turned(normal);
  paint = colour;
  gl_Position = project(at);
}`;
const SKIN_FRAGMENT = `${HEAD}${LIT}
in vec3 at, n;
flat in vec4 paint;
out vec4 colour;
void main() {
  vec3 way = at - eye;
  float hit = length(way);
  colour = vec4(shade(at, normalize(gl_FrontFacing ? n : -n), way / hit, paint, hit), 1);
}`;
const POINT_VERTEX = `${HEAD}
layout(location = 0) in vec3 place;
layout(location = 1) in vec3 label;
uniform float height; // of the picture [px]
out vec3 tint;
void main() {
  gl_Position = project(place);
  gl_PointSize = clamp(0.006 * height / (extent.y * max(gl_Position.w, 0.1)), 1.0, 6.0);
  tint = develop(mix(label, horizon, fog(gl_Position.w)));
}`;
const POINT_FRAGMENT = `${HEAD}
in vec3 tint;
out vec4 colour;
void main() { colour = vec4(tint, 1); }`;
const SHADOW_VERTEX = `${HEAD}${FETCH}
// Shadows on the floor: a capsule as seen along the light is a segment with a width.
uniform vec3 light, across, over; // towards the light, and both axes at right angles to it
uniform float softness, reach; // of an edge, by the way of the light; of contacts 0 and how high they reach
out vec2 q;
flat out vec3 shape; // length and both radii
flat out vec2 high; // how far light travels from both ends to the floor
void main() {
  int i = item();
  vec4 a = part(min(i, count - 1), 0), b = part(min(i, count - 1), 1);
  float low = min(a.y - a.w, b.y - b.w);
  if (i >= count || low > reach) { gl_Position = vec4(2, 2, 2, 1); return; }
  vec2 c = corner(), p = vec2(dot(a.xyz, across), dot(a.xyz, over)), d = vec2(dot(b.xyz, across), dot(b.xyz, over)) - p;
  float l = length(d);
  vec2 x = l > 1e-6 ? d / l : vec2(1, 0), y = vec2(-x.y, x.x);
  high = vec2(a.y, b.y) / light.y;
  float fade = softness * max(high.x, high.y) + (softness == 0.0 ? reach : 0.0) + 1.5 * pixel * length(a.xyz - eye);
  shape = vec3(l, a.w, b.w);
  q = vec2(c.y < 0.0 ? -a.w - fade : l + b.w + fade, c.x * (max(a.w, b.w) + fade));
  vec2 s = p + x * q.x + y * q.y;
  vec3 w = across * s.x + over * s.y;
  w -= light * w.y / light.y;
  gl_Position = project(w);
  // Depth does not matter here, and the floor may lie behind the eye.
  gl_Position.z = 0.0;
}`;
const SHADOW_FRAGMENT = `${HEAD}
in vec2 q;
flat in vec3 shape;
flat in vec2 high;
uniform float softness, reach;
out vec4 dark;
void main() {
  float t = clamp(q.x / max(shape.x, 1e-6), 0.0, 1.0), r = mix(shape.y, shape.z, t), way = max(mix(high.x, high.y, t), 0.0);
  float beside = length(vec2(q.x - t * shape.x, q.y));
  if (softness > 0.0) {
    float soft = max(softness * way, max(fwidth(q.x), fwidth(q.y)));
    float d = clamp(0.5 - 0.5 * (beside - r) / soft, 0.0, 1.0);
    d = d * d * (3.0 - 2.0 * d) * min(way / (0.4 * r), 1.0);
    dark = vec4(d, 0, 0, 1);
  } else {
    float far = sqrt(beside * beside + way * way), near = clamp(1.0 - (far - r) / reach, 0.0, 1.0);
    dark = vec4(0, way / max(far, 1e-4) * min(r * r / max(far * far, 1e-6), 1.0) * near * near, 0, 1);
  }
}`;
const FLOOR_VERTEX = `${HEAD}
out vec3 way;
void main() {
  vec2 c = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  way = ahead + right * (extent.x * c.x) + up * (extent.y * c.y);
  gl_Position = vec4(c, 0, 1);
}`;
const FLOOR_FRAGMENT = `${HEAD}
in vec3 way;
out vec4 colour;
uniform sampler2D shadows;
uniform vec3 zenith;
uniform vec4 floor_; // brightness, and how strong squares, lines and fine lines are
uniform vec4 arena; // centre and half sizes
uniform int arenaKind;
#ifdef HEAT
uniform sampler2D heat; // of strikes that have landed, over a part of the floor
uniform vec4 heatBox; // its corner and its sizes
uniform int heatKind; // 0 for strikes, 1 for values
#endif
float rise(float x) { float h = 0.5 * x; return 1.0 - abs((h - floor(h)) * 2.0 - 1.0); }
float checks(float x, float w) {
  return (rise(x + 0.5 * w) - rise(x - 0.5 * w)) / w * clamp(1.6 - 0.8 * w, 0.0, 1.0);
}
float stripes(float x, float w, float thick) {
  float low = x - 0.5 * w + 0.5 * thick, high = x + 0.5 * w + 0.5 * thick, below = floor(low), above = floor(high);
  return ((above - below) * thick + min(high - above, thick) - min(low - below, thick)) / w;
}
void main() {
  vec3 d = normalize(way);
  float climb = 1.0 - max(d.y, 0.0);
  vec3 sky = mix(horizon, zenith, 1.0 - climb * climb * climb);
  if (d.y > -1e-4) { colour = vec4(develop(sky), 1); return; }
  float t = min(eye.y / -d.y, 1e5), level = max(length(d.xz), 1e-4);
  vec2 p = eye.xz + t * d.xz, n = abs(d.xz) / level;
  float across = t * pixel, along = across / -d.y;
  vec2 w = max(vec2(across * n.y + along * n.x, across * n.x + along * n.y), 1e-5);
  float squares = checks(p.x, w.x) * checks(p.y, w.y);
  float line = 1.0 - (1.0 - stripes(0.2 * p.x, 0.2 * w.x, 0.008)) * (1.0 - stripes(0.2 * p.y, 0.2 * w.y, 0.008));
  float fine = clamp(1.3 - 45.0 * max(w.x, w.y), 0.0, 1.0);
  if (fine > 0.0) fine *= 1.0 - (1.0 - stripes(10.0 * p.x, 10.0 * w.x, 0.06)) * (1.0 - stripes(10.0 * p.y, 10.0 * w.y, 0.06));
  float outside = 0.0, border = 0.0;
  if (arenaKind > 0) {
    vec2 gap = abs(p - arena.xy);
    float beyond, wide;
    if (arenaKind == 1) { float r = max(length(gap), 1e-6); beyond = r - arena.z; wide = dot(gap, w) / r; }
    else { vec2 b = gap - arena.zw; bool first = b.x > b.y; beyond = first ? b.x : b.y; wide = first ? w.x : w.y; }
    float half_ = max(0.04, min(0.6 * wide, 0.3));
    border = max(min(beyond + 0.5 * wide, half_) - max(beyond - 0.5 * wide, -half_), 0.0) / wide;
    outside = clamp(beyond / wide + 0.5, 0.0, 1.0);
  }
  float albedo = (floor_.x + floor_.y * squares) * (1.0 - floor_.z * line) * (1.0 - floor_.w * fine) * (1.0 - 0.3 * outside);
  albedo += border * (0.85 - albedo);
  vec3 tint = vec3(albedo);
#ifdef HEAT
  vec2 at = (p - heatBox.xy) / heatBox.zw;
  if (at.x > 0.0 && at.x < 1.0 && at.y > 0.0 && at.y < 1.0) {
    float h = texture(heat, at).r;
    if (heatKind == 1) {
      vec3 low = mix(vec3(0.006, 0.01, 0.07), vec3(0.02, 0.09, 0.2), clamp(h * 4.0, 0.0, 1.0));
      low = mix(low, vec3(0.1, 0.3, 0.25), clamp(h * 4.0 - 1.0, 0.0, 1.0));
      low = mix(low, vec3(0.45, 0.6, 0.2), clamp(h * 4.0 - 2.0, 0.0, 1.0));
      tint = mix(tint, mix(low, vec3(1.0, 0.92, 0.5), clamp(h * 4.0 - 3.0, 0.0, 1.0)), 0.9 * smoothstep(0.5, 0.49, length(at - 0.5)));
    } else if (heatKind == 0) {
      // From the floor's own grey over red to bright yellow: lighter is more, to eyes that see no red too.
      vec3 warm = mix(vec3(0.35, 0.02, 0.05), mix(vec3(0.8, 0.16, 0.03), vec3(1.0, 0.85, 0.2), smoothstep(0.5, 1.0, h)), smoothstep(0.0, 0.5, h));
      tint = mix(tint, warm, smoothstep(0.02, 0.2, h) * 0.85);
    }
  }
#endif
  vec2 dark = texelFetch(shadows, ivec2(gl_FragCoord.xy), 0).rg;
  vec3 c = tint * (SUN * sun.y * (1.0 - dark.r) + (SKY - 0.03) * (1.0 - dark.g));
  colour = vec4(develop(mix(c, sky, fog(t))), 1);
}`;
const MOST_MARKS = 32, MARK_SECONDS = 0.28, MARK_SIZE = 0.24;
const MARK_VERTEX = `${HEAD}
uniform vec4 places[${MOST_MARKS}], kinds[${MOST_MARKS}]; // point and size; age, power, shape
out vec2 q;
flat out vec4 kind;
void main() {
  int c = gl_VertexID % 3 + gl_VertexID / 3;
  vec2 corner = vec2(c & 1, c >> 1) * 2.0 - 1.0;
  vec4 place = places[gl_InstanceID];
  kind = kinds[gl_InstanceID];
  q = corner * 2.2;
  vec3 to = normalize(place.xyz - eye);
  // It lies before the bodies that it is between, and is never too small to be seen.
  vec4 middle = project(place.xyz - to * 0.45);
  float size = max(place.w, 3.0 * pixel * middle.w);
  gl_Position = project(place.xyz - to * 0.45 + (right * q.x + up * q.y) * size);
}`;
const MARK_FRAGMENT = `${HEAD}
in vec2 q;
flat in vec4 kind;
out vec4 colour;
void main() {
  float square = dot(q, q), far = sqrt(square), age = kind.x, glow;
  if (square >= 4.8) discard;
  vec3 tint;
  if (kind.z == 1.0) { // warm star and ring
    float u = q.x + q.y, v = q.x - q.y, rings = far - 0.3 - 1.3 * age;
    float rays = 1.0 / (1.0 + 60.0 * q.x * q.x * q.y * q.y / (square + 0.02)) + 0.4 / (1.0 + 40.0 * u * u * v * v);
    glow = (1.2 + 1.5 * rays) / (1.0 + 30.0 * square) + 0.5 / (1.0 + 220.0 * rings * rings);
    tint = vec3(1.5, 1.15, 0.55);
  } else if (kind.z == 2.0) { // blue dot in a ring that stays
    float rings = far - 0.65;
    glow = 1.2 / (1.0 + 180.0 * rings * rings) + 1.2 / (1.0 + 40.0 * square);
    tint = vec3(0.35, 0.8, 1.9);
  } else if (kind.z == 3.0) { // green ring that grows
    float rings = far - 0.4 - 0.8 * age;
    glow = 0.9 / (1.0 + 260.0 * rings * rings);
    tint = vec3(0.35, 1.5, 0.4);
  } else { // grey cross
    float arm = min(abs(q.x + q.y), abs(q.x - q.y));
    glow = square < 0.3 ? 0.7 / (1.0 + 300.0 * arm * arm) : 0.0;
    tint = vec3(0.9, 0.9, 0.95);
  }
  float window = 1.0 - square / 4.8;
  colour = vec4(sqrt(min(tint * glow * kind.y * window * window * (1.0 - age) * (1.0 - age), 1.0)), 1);
}`;
const SHAPES = { landed: 1, thrown: 1, blocked: 2, evaded: 3, missed: 0 };

const defined = (word, shader) => shader.replace('\n', `\n#define ${word}\n`);

class Painter {
  constructor(canvas, crowd) {
    const gl = this.gl = canvas.getContext('webgl2', { antialias: false, alpha: false, powerPreference: 'high-performance' });
    if (!gl) throw Error('This browser has no WebGL 2, which the player draws with. Another browser, or one with '
      + 'hardware acceleration switched on, shows this page.');
    Object.assign(this, { canvas, crowd, scene: crowd.scene, hasty: false, median: 0, times: [] });
    this.quality = this.level = this.finest;
    canvas.addEventListener('webglcontextlost', event => { event.preventDefault(); this.lost = true; });
    canvas.addEventListener('webglcontextrestored', () => { this.lost = false; this.prepare(); });
    this.prepare();
  }

  prepare() {
    const gl = this.gl;
    const linked = {
      body: this.program(BODY_VERTEX, BODY_FRAGMENT),
      smoothBody: this.program(BODY_VERTEX, defined('SMOOTH', BODY_FRAGMENT)),
      shadow: this.program(SHADOW_VERTEX, SHADOW_FRAGMENT),
      floor: this.program(FLOOR_VERTEX, FLOOR_FRAGMENT),
      mark: this.program(MARK_VERTEX, MARK_FRAGMENT),
      skin: this.program(SKIN_VERTEX, SKIN_FRAGMENT),
      prop: this.program(PROP_VERTEX, SKIN_FRAGMENT),
      point: this.program(POINT_VERTEX, POINT_FRAGMENT),
    };
    this.programs = Object.fromEntries(Object.entries(linked).map(([name, one]) => [name, this.checked(one)]));
    this.rows = Math.max(1, Math.ceil(this.crowd.capsules / ROW));
    this.padded = new Float32Array(this.rows * ROW * FLOATS);
    this.crowd.shapes = this.padded.subarray(0, this.crowd.shapes.length);
    this.shapes = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.shapes);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, ROW * 3, this.rows, 0, gl.RGBA, gl.FLOAT, null);
    this.nearest();
    // One instance a capsule is slow in software: a batch is an instance.
    const indices = new Uint16Array(6 * ROW);
    for (let i = 0; i < ROW; i++) indices.set([0, 1, 2, 2, 3, 0].map(corner => 4 * i + corner), 6 * i);
    this.quads = gl.createVertexArray();
    gl.bindVertexArray(this.quads);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    this.none = gl.createVertexArray();
    this.skins = new Map();
    this.boneTexture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.boneTexture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, this.crowd.boneRow / 4, MOST_SKINS, 0, gl.RGBA, gl.FLOAT, null);
    this.nearest();
    this.pointBuffer = gl.createBuffer();
    this.pointArray = this.attributes([[0, this.pointBuffer, 3, 24, 0], [1, this.pointBuffer, 3, 24, 12]]);
    gl.bindVertexArray(null);
    this.dark = gl.createTexture();
    this.heatMap = gl.createTexture();
    this.heated = null;
    gl.bindTexture(gl.TEXTURE_2D, this.heatMap);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, HEAT, HEAT, 0, gl.RED, gl.UNSIGNED_BYTE, null);
    this.nearest(gl.LINEAR);
    this.darkFrame = gl.createFramebuffer();
    this.smooth = gl.createFramebuffer();
    this.smoothColour = gl.createRenderbuffer();
    this.whole = gl.createFramebuffer();
    this.wholeColour = gl.createRenderbuffer();
    this.depth = gl.createRenderbuffer();
    this.size = '';
  }

  // Returns vertex attributes: the place of each, its buffer, how many numbers, and where these lie.
  attributes(list) {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    for (const [place, buffer, size, stride, offset, kind = gl.FLOAT] of list) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(place);
      if (place === 2) gl.vertexAttribIPointer(place, size, kind, stride, offset);
      else gl.vertexAttribPointer(place, size, kind, kind !== gl.FLOAT, stride, offset);
    }
    gl.bindVertexArray(null);
    return array;
  }

  // A new buffer with some values.
  fill(target, values) {
    const gl = this.gl, buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, values, gl.STATIC_DRAW);
    return buffer;
  }

  // The mesh of a build as fine as wanted, which goes to the graphics memory once; faces of coarse ones have no parts.
  mesh(figure, build, detail) {
    const { number, ends } = this.scene.figures[figure].skins[build], key = `${number} ${detail}`;
    if (this.skins.has(key)) return this.skins.get(key);
    const { tables: t } = this.scene, triangles = t[`skin_${number}_triangles`], parts = new Uint8Array(triangles.length / 3);
    ends.forEach((end, part) => parts.fill(part, part ? ends[part - 1] : 0, end));
    if (detail === 0) this.skins.set(key, this.upload(number, triangles, parts));
    else {
      const plain = parts.map(part => FACE.includes(part) ? 0 : part);
      coarsen(t[`skin_${number}_vertices`], triangles, plain, COARSE).forEach((made, i) => this.skins.set(`${number} ${i + 1}`, this.upload(number, ...made)));
    }
    return this.skins.get(key);
  }

  // Sends a mesh of triangles to the graphics memory, with vertices of its own for each part.
  upload(number, triangles, parts) {
    const gl = this.gl, indices = new Uint16Array(triangles.length), known = new Map(), owned = [], bytes = [];
    triangles.forEach((vertex, i) => {
      const key = vertex * SKIN_PARTS + parts[i / 3 | 0];
      if (!known.has(key)) {
        known.set(key, owned.length);
        owned.push(vertex);
        bytes.push(parts[i / 3 | 0]);
      }
      indices[i] = known.get(key);
    });
    const pick = (name, width, kind, wide = width) => {
      const from = this.scene.tables[`skin_${number}_${name}`], out = new kind(wide * owned.length);
      owned.forEach((vertex, i) => { for (let k = 0; k < width; k++) out[wide * i + k] = from[width * vertex + k]; });
      return out;
    };
    const normals = Int8Array.from(pick('normals', 3, Uint8Array, 4), (value, i) => i % 4 < 3 ? value - 128 : bytes[i >> 2]);
    const array = this.attributes([[0, this.fill(gl.ARRAY_BUFFER, pick('vertices', 3, Float32Array)), 3, 0, 0], [1, this.fill(gl.ARRAY_BUFFER, normals), 4, 0, 0, gl.BYTE],
      [2, this.fill(gl.ARRAY_BUFFER, pick('joints', 4, Uint8Array)), 4, 0, 0, gl.UNSIGNED_BYTE], [3, this.fill(gl.ARRAY_BUFFER, pick('weights', 4, Uint8Array)), 4, 0, 0, gl.UNSIGNED_BYTE]]);
    gl.bindVertexArray(array);
    this.fill(gl.ELEMENT_ARRAY_BUFFER, indices);
    gl.bindVertexArray(null);
    return { array, count: indices.length };
  }

  // Draws the skins of the avatars that have one now; those of one mesh are instances of it.
  drawSkins(view) {
    const gl = this.gl, { crowd, scene: { tables: t } } = this, { skinned } = crowd;
    if (!skinned.length) return;
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, this.boneTexture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, crowd.boneRow / 4, skinned.length, gl.RGBA, gl.FLOAT, crowd.bones);
    this.use('skin', view, {});
    gl.enable(gl.CULL_FACE);
    const same = (a, b) => t.figure[a] === t.figure[b] && t.bone_skin[a] === t.bone_skin[b] && crowd.details[a] === crowd.details[b];
    for (let first = 0, end = 0; first < skinned.length; first = end) {
      while (end < skinned.length && same(skinned[first], skinned[end])) end++;
      const { array, count } = this.mesh(t.figure[skinned[first]], t.bone_skin[skinned[first]], crowd.details[skinned[first]]);
      gl.bindVertexArray(array);
      gl.uniform1i(this.programs.skin.uniforms.body, first);
      gl.drawElementsInstanced(gl.TRIANGLES, count, gl.UNSIGNED_SHORT, 0, end - first);
    }
    gl.disable(gl.CULL_FACE);
  }

  // Draws the meshes that these avatars carry.
  drawProps(view) {
    const gl = this.gl;
    for (const [mesh, joint, turn, size] of this.crowd.meshes) {
      if (!this.skins.has(mesh)) {
        const [places, normals] = [mesh.places, mesh.normals].map(values => this.fill(gl.ARRAY_BUFFER, new Float32Array(values)));
        this.skins.set(mesh, this.attributes([[0, places, 3, 0, 0], [1, normals, 3, 0, 0]]));
      }
      this.use('prop', view, { joint, turn, size, colour: mesh.paint });
      gl.bindVertexArray(this.skins.get(mesh));
      gl.drawArrays(gl.TRIANGLES, 0, mesh.places.length / 3);
    }
  }

  drawPoints(view) {
    const gl = this.gl, { crowd } = this;
    if (!crowd.points) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.pointBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, crowd.cloud.subarray(0, 6 * crowd.points), gl.DYNAMIC_DRAW);
    this.use('point', view, { height: this.height });
    gl.bindVertexArray(this.pointArray);
    gl.drawArrays(gl.POINTS, 0, crowd.points);
  }

  nearest(filter = this.gl.NEAREST) {
    const gl = this.gl;
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, filter);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram(), logs = [];
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      logs.push(() => gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(program);
    return { program, logs };
  }

  // What is linked is looked at once all are: drivers work on several at a time.
  checked({ program, logs }) {
    const { gl } = this, uniforms = {};
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw Error(`The graphics driver refuses a shader: ${gl.getProgramInfoLog(program)} ${logs.map(log => log()).join(' ')}`);
    for (let i = 0, n = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0; i < n; i++) {
      const { name } = gl.getActiveUniform(program, i);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  get finest() { return devicePixelRatio > 1.25 ? 0 : 1; }

  // What is dragged must follow the pointer: meanwhile pictures are coarser, unless they are swift as they are.
  hurry(hasty) {
    if (hasty === this.hasty) return;
    this.hasty = hasty;
    this.level = Math.min(this.quality + (hasty ? HASTE * Math.min(Math.floor(this.median / SWIFT), 2) : 0), QUALITIES.length - 1);
    this.times = [];
  }

  // Whether what is dragged waits for pictures.
  get late() { return this.hasty && this.median > SWIFT; }

  // Sizes pictures by quality; still pictures are as fine as can be.
  resize(still) {
    const gl = this.gl, { canvas } = this, [scale, samples] = QUALITIES[still ? this.finest : this.level];
    const ratio = scale > 1 ? Math.min(devicePixelRatio, scale) : scale;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    const size = `${width} ${height} ${samples}`;
    if (size === this.size) return;
    Object.assign(this, { size, width, height, samples });
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.bindTexture(gl.TEXTURE_2D, this.dark);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG8, width, height, 0, gl.RG, gl.UNSIGNED_BYTE, null);
    this.nearest();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.darkFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.dark, 0);
    for (const [frame, buffer, count, format, place] of [[this.smooth, this.smoothColour, samples, gl.RGBA8, gl.COLOR_ATTACHMENT0],
      [this.smooth, this.depth, samples, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT], [this.whole, this.wholeColour, 0, gl.RGBA8, gl.COLOR_ATTACHMENT0]]) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, count, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
    }
  }

  // Takes note of the time between two pictures, and changes quality where it is too long or short.
  pace(milliseconds) {
    if (milliseconds > 2000) return;
    this.times.push(milliseconds);
    if (this.times.length < (this.hasty ? 3 : 12)) return;
    const median = [...this.times].sort((a, b) => a - b)[this.times.length >> 1], slow = this.hasty ? SWIFT : SLOW;
    if (!this.hasty) this.median = median;
    if (median > slow && this.level < QUALITIES.length - 1) this.level += median > 2 * slow ? 2 : 1;
    else if (median < FAST && this.level > this.finest && this.times.length > 90 && !this.hasty) this.level -= 1;
    else if (this.times.length < 120) return;
    this.level = Math.min(this.level, QUALITIES.length - 1);
    if (!this.hasty) this.quality = this.level;
    this.times = [];
  }

  use(name, view, more, count = this.crowd.drawn) {
    const gl = this.gl, { program, uniforms } = this.programs[name], look = LOOKS[this.theme];
    gl.useProgram(program);
    const values = {
      eye: view.eye, ahead: view.ahead, right: view.right, up: view.up, sun: this.scene.sun, horizon: look.horizon,
      extent: [view.wide, view.tall], pixel: 2 * view.tall / this.height, haze: view.haze, ...more,
    };
    for (const [key, value] of Object.entries(values)) {
      const place = uniforms[key];
      if (place === undefined) continue;
      if (typeof value === 'number') gl.uniform1f(place, value);
      else gl[`uniform${value.length}fv`](place, value);
    }
    for (const [key, value] of [['count', count], ['shapes', 0], ['shadows', 1], ['heat', 2], ['bones', 3], ['arenaKind', this.scene.arena[0]], ['heatKind', this.heat?.isValues ? 1 : 0]])
      if (uniforms[key] !== undefined) gl.uniform1i(uniforms[key], value);
  }

  quadsOf(count = this.crowd.drawn) {
    this.gl.bindVertexArray(this.quads);
    this.gl.drawElementsInstanced(this.gl.TRIANGLES, 6 * ROW, this.gl.UNSIGNED_SHORT, 0, Math.ceil(count / ROW));
  }

  // Marks of the strikes of the last moment, as bright as fists were fast.
  marks(view, seconds) {
    const gl = this.gl, { tables: t, outcomes } = this.scene, places = [], kinds = [];
    for (let i = placeAfter(t.strike_time, seconds + 1e-6) - 1; i >= 0 && kinds.length < 4 * MOST_MARKS; i--) {
      const age = (seconds - t.strike_time[i]) / MARK_SECONDS;
      if (age >= 1) break;
      places.push(...t.strike_point.slice(3 * i, 3 * i + 3), MARK_SIZE);
      kinds.push(age, 0.55 + 0.45 * clamp(t.strike_speed[i] / 9, 0, 1), SHAPES[outcomes[t.strike_outcome[i]]], 0);
    }
    if (!kinds.length) return;
    this.use('mark', view, {});
    gl.uniform4fv(this.programs.mark.uniforms['places[0]'], places);
    gl.uniform4fv(this.programs.mark.uniforms['kinds[0]'], kinds);
    gl.enable(gl.BLEND);
    gl.blendEquation(gl.FUNC_ADD);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_COLOR);
    gl.depthMask(false);
    gl.bindVertexArray(this.none);
    gl.drawArraysInstanced(gl.TRIANGLES, 0, 6, kinds.length / 4);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  // Draws the crowd as it is placed; marks of the strikes around a time where one is given.
  draw(view, still, seconds = null) {
    if (this.lost) return;
    const gl = this.gl, { sun } = this.scene, rows = Math.ceil(this.crowd.drawn / ROW), look = LOOKS[this.theme];
    this.resize(still);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.shapes);
    if (rows) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ROW * 3, rows, gl.RGBA, gl.FLOAT, this.padded);
    gl.viewport(0, 0, this.width, this.height);
    gl.disable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.darkFrame);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendEquation(gl.MAX);
    gl.blendFunc(gl.ONE, gl.ONE);
    const level = Math.hypot(sun[0], sun[2]) || 1, across = [-sun[2] / level, 0, sun[0] / level];
    this.use('shadow', view, { light: sun, across, over: cross3(sun, across), softness: 0.03, reach: 1e9 });
    if (rows) this.quadsOf();
    this.use('shadow', view, { light: [0, 1, 0], across: [1, 0, 0], over: [0, 0, 1], softness: 0, reach: 0.3 });
    if (rows) this.quadsOf();
    gl.disable(gl.BLEND);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.smooth);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.colorMask(true, true, true, false);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.dark);
    gl.activeTexture(gl.TEXTURE2);
    gl.bindTexture(gl.TEXTURE_2D, this.heatMap);
    if (this.heat && this.heat !== this.heated) {
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, HEAT, HEAT, gl.RED, gl.UNSIGNED_BYTE, this.heat.bytes);
      this.heated = this.heat;
    }
    // Few look at a map of the floor, and pictures without one are drawn sooner.
    if (this.heat) this.programs.map ??= this.checked(this.program(FLOOR_VERTEX, defined('HEAT', FLOOR_FRAGMENT)));
    this.use(this.heat ? 'map' : 'floor', view, { zenith: look.zenith, floor_: look.floor, arena: this.scene.arena.slice(1), ...this.heat && { heatBox: this.heat.box } });
    gl.bindVertexArray(this.none);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
    if (this.samples) gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    const { visible } = this.crowd, bare = this.crowd.look === 'cloud' ? 0 : visible;
    if (bare) {
      this.use(this.samples ? 'smoothBody' : 'body', view, {}, bare);
      this.quadsOf(bare);
    }
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    this.drawSkins(view);
    this.drawProps(view);
    this.drawPoints(view);
    if (seconds !== null) this.marks(view, seconds);
    gl.colorMask(true, true, true, true);
    // Samples are put together first: the canvas may have another format.
    for (const [from, to] of this.samples ? [[this.smooth, this.whole], [this.whole, null]] : [[this.smooth, null]]) {
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to);
      gl.blitFramebuffer(0, 0, this.width, this.height, 0, 0, this.width, this.height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.bindVertexArray(null);
  }
}
