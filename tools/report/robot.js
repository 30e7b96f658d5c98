// The robots of a report in 3D, by three.js: the visuals of their URDF, the tool's path, and the
// reference's posture as a ghost. A body without visuals is drawn as cylinders between joints.
'use strict';
var report_robot = (() => {
  const vector = a => new THREE.Vector3(...a);
  const up = new THREE.Vector3(0, 1, 0);  // axis of a three.js cylinder
  const robots = [];
  let renderer, scene, camera;

  function cylinder(from, to, radius, material) {
    const along = to.clone().sub(from);
    const mesh = new THREE.Mesh(new THREE.CylinderBufferGeometry(radius, radius, along.length(), 20), material);
    mesh.position.copy(from).addScaledVector(along, 0.5);
    mesh.quaternion.setFromUnitVectors(up, along.clone().normalize());
    return mesh;
  }

  function placed({R, p}) {
    const group = new THREE.Group();
    group.applyMatrix(new THREE.Matrix4().set(R[0], R[1], R[2], p[0], R[3], R[4], R[5], p[1], R[6], R[7], R[8], p[2], 0, 0, 0, 1));
    return group;
  }

  function numbers(element, name, otherwise) {
    const values = element && element.hasAttribute(name) ? element.getAttribute(name).trim().split(/\s+/).map(Number) : [];
    return values.length === otherwise.length && values.every(Number.isFinite) ? values : otherwise;
  }

  const text_of = bytes => new TextDecoder().decode(bytes);
  const readers = {
    stl: bytes => {
      const geometry = new THREE.STLLoader().parse(bytes.buffer);
      geometry.computeVertexNormals();  // many files contain zero normals
      return new THREE.Mesh(geometry);
    },
    obj: bytes => new THREE.OBJLoader().parse(text_of(bytes)),
    dae: bytes => {
      const {scene} = new THREE.ColladaLoader().parse(text_of(bytes), '');
      scene.quaternion.set(0, 0, 0, 1);  // keeps the file's axes; three.js would rotate them
      return scene;
    },
  };

  /// Returns the mesh of a <geometry>, or nothing if it cannot be drawn.
  function shape_of(run, element) {
    const radius = numbers(element, 'radius', [0])[0];
    if (element.tagName === 'box') return new THREE.Mesh(new THREE.BoxBufferGeometry(...numbers(element, 'size', [0, 0, 0])));
    if (element.tagName === 'sphere') return new THREE.Mesh(new THREE.SphereBufferGeometry(radius, 24, 16));
    if (element.tagName === 'cylinder') {
      const geometry = new THREE.CylinderBufferGeometry(radius, radius, numbers(element, 'length', [0])[0], 24);
      return new THREE.Mesh(geometry.rotateX(Math.PI / 2));
    }
    const name = element.getAttribute('filename');
    run.read = run.read || new Map();
    if (!run.read.has(name)) {
      run.read.set(name, null);
      try {
        const bytes = Uint8Array.from(atob(run.meshes[name]), each => each.charCodeAt(0));
        run.read.set(name, readers[name.split('.').pop().toLowerCase()](bytes));
      } catch (error) {
        console.warn(`${name} is not drawn: ${error.message}`);
      }
    }
    const mesh = run.read.get(name) && run.read.get(name).clone();
    if (mesh) mesh.scale.multiply(vector(numbers(element, 'scale', [1, 1, 1])));
    return mesh;
  }

  /// Draws the visuals.
  /// @return the bodies (-1: the ground) that have one
  function dress(run, group_of, material) {
    const dressed = new Set(), robot = new DOMParser().parseFromString(run.urdf, 'application/xml');
    const colours = new Map();
    const colour = element => element && numbers(element.querySelector('color'), 'rgba', [0, 0, 0, 0]);
    for (const each of robot.querySelectorAll('material')) {
      if (each.querySelector('color')) colours.set(each.getAttribute('name'), colour(each));
    }
    for (const visual of [...robot.querySelectorAll('robot > link > visual')].slice(0, 1000)) {
      const frame = run.links[visual.parentElement.getAttribute('name')];
      const element = visual.querySelector('geometry > *'), origin = visual.querySelector('origin');
      const shape = frame && element && shape_of(run, element);
      if (!shape) continue;
      const given = visual.querySelector('material');
      const own = material(given && (given.querySelector('color') ? colour(given) : colours.get(given.getAttribute('name'))));
      shape.traverse(each => {
        if (!each.isMesh) return;
        each.material = own;
        if (!each.geometry.attributes.normal) each.geometry.computeVertexNormals();
      });
      const at = new THREE.Group();
      at.position.set(...numbers(origin, 'xyz', [0, 0, 0]));
      at.rotation.set(...numbers(origin, 'rpy', [0, 0, 0]), 'ZYX');
      if (origin && origin.hasAttribute('quat_xyzw')) at.quaternion.set(...numbers(origin, 'quat_xyzw'));
      group_of(frame.body).add(placed(frame).add(at.add(shape)));
      dressed.add(frame.body);
    }
    return dressed;
  }

  /// Builds a tree of groups, one for each body, that `pose` moves.
  /// @param visual returns the material of a colour
  function build(run, radius, link, joint, visual) {
    const ground = new THREE.Group();
    const bodies = run.bodies.map(body => Object.assign(new THREE.Group(), {body}));
    const draw = (group, ends) => {
      for (const end of ends.map(vector)) {
        if (end.length() > 1e-6) group.add(cylinder(new THREE.Vector3(), end, radius, link));
      }
    };
    const group_of = body => body < 0 ? ground : bodies[body];
    const dressed = dress(run, group_of, visual);
    if (!dressed.has(-1)) draw(ground, run.ends);
    for (const [k, group] of bodies.entries()) {
      const {parent, axis, ends} = group.body;
      group_of(parent).add(placed(group.body).add(group));
      if (dressed.has(k)) continue;
      const half = vector(axis).multiplyScalar(1.6 * radius);
      group.add(cylinder(half.clone().negate(), half, 1.5 * radius, joint));
      draw(group, ends);
    }
    const tools = run.tools.map(({body, p}) => {
      const tool = new THREE.Object3D();
      tool.position.set(...p);
      return group_of(body).add(tool), tool;
    });
    return {ground, bodies, tools};
  }

  function pose(robot, q) {
    for (const group of robot.bodies) {
      const {axis, prismatic, joint, multiplier, offset} = group.body;
      const position = multiplier * q(joint) + offset;
      if (prismatic) group.position.copy(vector(axis)).multiplyScalar(position);
      else group.quaternion.setFromAxisAngle(vector(axis), position);
    }
  }

  /// Draws the tools' paths between 0 and end_s.
  function add_paths(robot, end_s, colour) {
    const pieces = 800;
    const paths = robot.tools.map(() => []);
    for (let k = 0; k <= pieces; ++k) {
      pose(robot, joint => robot.q[joint](end_s * k / pieces));
      robot.ground.updateMatrixWorld(true);
      robot.tools.forEach((tool, i) => {
        const point = new THREE.Vector3().setFromMatrixPosition(tool.matrixWorld);
        if (Number.isFinite(point.lengthSq())) paths[i].push(point);
      });
    }
    for (const path of paths) {
      scene.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(path), new THREE.LineBasicMaterial({color: colour})));
    }
    return new THREE.Box3().setFromPoints(paths.flat());
  }

  /// Adds a robot with its ghost and path. Different robots stand side by side.
  function add(run, signal, end_s, aside, several) {
    const q = run.joints.map(joint => signal(run.number, 'q', joint));
    if (q.some(each => !each)) return null;
    const reach = run.bodies.reduce((sum, body) => sum + Math.hypot(...body.p) + Math.max(0, ...body.ends.map(end => Math.hypot(...end))) / 2, 0) || 1;
    const radius = 0.035 * reach / Math.sqrt(run.bodies.length / 2 + 1);
    const material = options => new THREE.MeshLambertMaterial(options);
    const colour = several ? run.colour : '#f08a1d';
    const visual = rgba => material({color: several || !rgba ? colour : new THREE.Color(...rgba)});
    const robot = Object.assign(build(run, radius, material({color: colour}), material({color: '#5c6b80'}), visual), {q, reach});
    robot.ground.position.x = aside;
    scene.add(robot.ground);
    const q_ref = run.joints.map(joint => signal(run.number, 'q_ref', joint));
    if (q_ref.every(Boolean)) {
      const ghost = material({color: '#8899aa', transparent: true, opacity: 0.6, depthWrite: false,
        // Behind the robot where both overlap.
        polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2});
      robot.ghost = Object.assign(build(run, 0.85 * radius, ghost, ghost, () => ghost), {q: q_ref});
      robot.ground.add(robot.ghost.ground);
    }
    const path = end_s ? add_paths(robot, end_s, colour) : new THREE.Box3();
    if (!end_s) pose(robot, joint => robot.q[joint](0));
    if (robot.ghost) pose(robot.ghost, joint => robot.ghost.q[joint](0));
    robot.box = path.union(new THREE.Box3().setFromObject(robot.ground)).expandByScalar(end_s ? 0 : 0.15 * reach);
    return robot;
  }

  function look_at(box) {
    // Without postures the box is empty, and a camera at its centre would see nothing.
    if (box.isEmpty() || ![...box.min.toArray(), ...box.max.toArray()].every(Number.isFinite)) {
      box = new THREE.Box3(new THREE.Vector3(-1, -1, -1), new THREE.Vector3(1, 1, 1));
    }
    const centre = box.getCenter(new THREE.Vector3()), radius = box.getSize(new THREE.Vector3()).length() / 2;
    const grid = new THREE.GridHelper(4 * radius, 16, '#999999', '#999999');
    grid.rotation.x = Math.PI / 2;
    grid.material.transparent = true;
    grid.material.opacity = 0.35;
    grid.position.set(centre.x, centre.y, 0);
    scene.add(grid);
    camera.near = radius / 50;
    camera.far = 50 * radius;
    const towards = new THREE.Vector3(0.45, -1, 0.35).normalize();
    const right = new THREE.Vector3().crossVectors(camera.up, towards).normalize();
    const up = new THREE.Vector3().crossVectors(towards, right);
    const {clientWidth, clientHeight} = renderer.domElement.parentElement;
    const tall = Math.tan(camera.fov * Math.PI / 360), wide = tall * (clientWidth / clientHeight || 1);
    // Distance from which each corner is visible.
    const distances = [0, 1, 2, 3, 4, 5, 6, 7].map(corner => {
      const p = new THREE.Vector3(...['x', 'y', 'z'].map((axis, i) => (corner >> i & 1 ? box.max : box.min)[axis])).sub(centre);
      return p.dot(towards) + Math.max(Math.abs(p.dot(up)) / tall, Math.abs(p.dot(right)) / wide);
    });
    camera.position.copy(centre).addScaledVector(towards, 1.05 * Math.max(...distances));
    const controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.target.copy(centre);
    controls.addEventListener('change', render);
    controls.update();
  }

  const render = () => renderer.render(scene, camera);

  function resize() {
    const {clientWidth, clientHeight} = renderer.domElement.parentElement;
    if (!clientWidth || !clientHeight) return;
    renderer.setSize(clientWidth, clientHeight);
    camera.aspect = clientWidth / clientHeight;
    camera.updateProjectionMatrix();
    render();
  }

  /// Starts the drawing. signal(run, name, joint) is a function of time, or nothing if the log has
  /// none.
  function start(runs, signal, end_s) {
    const place = document.getElementById('robot');
    const canvas = document.createElement('canvas');
    const context = canvas.getContext('webgl', {antialias: true, alpha: true});
    if (!context) {
      place.textContent = 'This browser has no WebGL: the robot cannot be shown.';
      place.className = 'without';
      return;
    }
    place.append(canvas);
    renderer = new THREE.WebGLRenderer({canvas, context, alpha: true});
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    scene = new THREE.Scene();
    camera = new THREE.PerspectiveCamera(35, 1, 0.01, 100);
    camera.up.set(0, 0, 1);
    scene.add(new THREE.HemisphereLight('#ffffff', '#777788', 1), camera);
    const light = new THREE.DirectionalLight('#ffffff', 0.5);
    camera.add(light);
    const alike = runs.every(run => JSON.stringify(run.bodies) === JSON.stringify(runs[0].bodies));
    let aside = 0;
    for (const run of runs) {
      const robot = add(run, signal, end_s, aside, runs.length > 1);
      if (!robot) continue;
      robots.push(robot);
      if (!alike) aside += 1.2 * robot.reach;
    }
    if (!robots.length) {
      place.textContent = 'The log holds no positions: the robot cannot be shown.';
      place.className = 'without';
      return;
    }
    look_at(robots.reduce((box, robot) => box.union(robot.box), new THREE.Box3()));
    api.drawn = true;
    addEventListener('resize', resize);
    resize();
  }

  function move(t) {
    for (const robot of robots) {
      pose(robot, joint => robot.q[joint](t));
      if (robot.ghost) pose(robot.ghost, joint => robot.ghost.q[joint](t));
    }
    render();
  }

  const api = {start, move, robots, drawn: false};
  return api;
})();
report.start();
