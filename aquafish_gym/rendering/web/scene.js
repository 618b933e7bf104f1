"use strict";
// What replays and live pages draw with: three.js, fish, light, floor and text. Lengths are in
// units. Thirteen numbers of a part are its position, its turn, its size and its colour.

// Returns the bytes that were packed by gzip and base64.
function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

// Runs the three.js that an element holds, and returns it.
async function loadThree(id) {
  const library = document.createElement("script"); // which the page's policy allows by its hash
  const packed = document.getElementById(id).textContent;
  library.textContent = new TextDecoder().decode(await unpack(packed));
  document.head.append(library);
  return THREE;
}

// Returns what draws: with smooth edges and textures, unless a program does a graphics card's work.
function makeRenderer(three) {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const card = info ? context.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  const programs = /swiftshader|llvmpipe|software|basic render/i;
  return new three.WebGLRenderer({ antialias: !programs.test(card) });
}

function addMesh(three, parent, geometry, color) {
  const material = new three.MeshStandardMaterial({ color, roughness: 0.6 });
  const mesh = new three.Mesh(geometry, material);
  parent.add(mesh);
  return mesh;
}

function addText(parent, kind, words) {
  const element = document.createElement("span");
  element.className = kind;
  element.textContent = words;
  parent.append(element);
  return element;
}

// Returns a fish of some parts, whose capsule is so wide and long, with a band of a colour.
function addFish(three, scene, count, wide, long, colour) {
  const capsule = (radius, length) => new three.CapsuleGeometry(radius, length, 16, 40);
  const body = new three.Group();
  const band = addMesh(three, body, capsule(wide / 2 + 0.02, 0.1), colour);
  const parts = Array.from({ length: count }, (_, k) => {
    const cube = k && new three.BoxGeometry(1, 1, 1);
    const part = addMesh(three, body, cube || capsule(wide / 2, long - wide), "white");
    part.castShadow = true;
    return part;
  });
  scene.add(body);
  return { body, band, parts };
}

// Sets the k-th part of a fish.
function showPart(three, part, k, numbers) {
  const [x, y, z, ...turn] = numbers.slice(0, 7);
  const size = numbers.slice(7, 10);
  part.position.set(x, y, z);
  part.quaternion.set(...turn);
  part.visible = size[0] > 0;
  part.scale.set(...(k ? size : [1, 1, 1]));
  part.material.color.setRGB(...numbers.slice(10), three.SRGBColorSpace);
}

// Returns round marks of a path, of which none is shown yet.
function addTrail(three, scene, colour, count) {
  const flat = new three.MeshBasicMaterial({ color: colour });
  const trail = new three.InstancedMesh(new three.CircleGeometry(0.1, 16), flat, count);
  trail.frustumCulled = false;
  trail.count = 0;
  scene.add(trail);
  return trail;
}

// Adds water, sky and a sun whose shadows reach so far about its target, and returns the sun.
function addLight(three, renderer, scene, water, half) {
  const sun = new three.DirectionalLight("#ffffff", 2);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  sun.shadow.normalBias = 0.05;
  const range = { left: -half, right: half, top: half, bottom: -half, far: 2 * half };
  Object.assign(sun.shadow.camera, range);
  renderer.shadowMap.enabled = true;
  scene.background = new three.Color(water);
  scene.fog = new three.Fog(water, 40, 110);
  scene.add(sun, sun.target, new three.HemisphereLight("#ffffff", "#9fc6d8", 2.2));
  return sun;
}

// Returns the sand, with lines at two spacings. It is as wide as the fog lets one see.
function addFloor(three, renderer, scene, grid, colours) {
  const width = 400;
  const sand = addMesh(three, scene, new three.PlaneGeometry(width, width), "white");
  sand.material.map = gridTexture(three, renderer, grid, colours, width);
  sand.receiveShadow = true;
  return sand;
}

// One tile is as wide as the wide grid; a texture is smooth where lines would flicker.
function gridTexture(three, renderer, [narrow, wide], colours, width) {
  const tile = Object.assign(document.createElement("canvas"), { width: 1024, height: 1024 });
  const pen = tile.getContext("2d");
  pen.fillStyle = colours.sand;
  pen.fillRect(0, 0, 1024, 1024);
  pen.fillStyle = colours.grid;
  for (let at = 0; at <= wide; at += narrow) {
    const half = at % wide ? 2 : 5;
    pen.fillRect(0, (1024 * at) / wide - half, 1024, 2 * half);
    pen.fillRect((1024 * at) / wide - half, 0, 2 * half, 1024);
  }
  const texture = new three.CanvasTexture(tile);
  texture.colorSpace = three.SRGBColorSpace;
  texture.wrapS = texture.wrapT = three.RepeatWrapping;
  texture.repeat.set(width / wide, width / wide);
  const smooth = renderer.getContext().getContextAttributes().antialias;
  texture.anisotropy = smooth ? renderer.capabilities.getMaxAnisotropy() : 1;
  return texture;
}

// Puts text where a point is seen.
function placeText(element, point, camera, stage) {
  const { x, y, z } = point.clone().project(camera);
  const left = ((x + 1) * stage.clientWidth) / 2;
  const top = ((1 - y) * stage.clientHeight - element.offsetHeight) / 2;
  element.style.transform = `translate(${left}px, ${top}px)`;
  element.style.visibility = z < 1 ? "visible" : "hidden"; // it may be behind the camera
}

// Fits what is drawn to the stage.
function fitStage(renderer, camera, stage) {
  renderer.setPixelRatio(Math.min(2, devicePixelRatio));
  renderer.setSize(stage.clientWidth, stage.clientHeight);
  camera.aspect = stage.clientWidth / stage.clientHeight;
  camera.updateProjectionMatrix();
}

// The directions of the camera from what it sees, by the names of the views.
const VIEWS = { side: [1, -0.4, 0.6], top: [0, -0.01, 1], behind: [0, -1, 0.8] };
