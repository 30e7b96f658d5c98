// The robots of a report in 3D, by three.js: cylinders between joints, as the log's mechanics have
// them (a log holds no visuals), the tool's path, and the reference's posture as a ghost.
'use strict';
var report_robot = (() => {
  const vector = a => new THREE.Vector3(...a);
  const up = new THREE.Vector3(0, 1, 0);  // a three.js cylinder's axis
  const robots = [];
  let renderer, scene, camera;

  function cylinder(from, to, radius, material) {
    const along = to.clone().sub(from);
    const mesh = new THREE.Mesh(new THREE.CylinderBufferGeometry(radius, radius, along.length(), 20), material);
    mesh.position.copy(from).addScaledVector(along, 0.5);
    mesh.quaternion.setFromUnitVectors(up, along.clone().normalize());
    return mesh;
  }

  /// A tree of groups, one for each body, that `pose` moves.
  function build(run, radius, link, joint) {
    const ground = new THREE.Group();
    const bodies = run.bodies.map(body => Object.assign(new THREE.Group(), {body}));
    const draw = (group, ends) => {
      for (const end of ends.map(vector)) {
        if (end.length() > 1e-6) group.add(cylinder(new THREE.Vector3(), end, radius, link));
      }
    };
    draw(ground, run.ends);
    for (const group of bodies) {
      const {parent, R, p, axis, ends} = group.body;
      const placed = new THREE.Group();
      placed.applyMatrix(new THREE.Matrix4().set(R[0], R[1], R[2], p[0], R[3], R[4], R[5], p[1], R[6], R[7], R[8], p[2], 0, 0, 0, 1));
      placed.add(group);
      (parent < 0 ? ground : bodies[parent]).add(placed);
      const half = vector(axis).multiplyScalar(1.6 * radius);
      group.add(cylinder(half.clone().negate(), half, 1.5 * radius, joint));
      draw(group, ends);
    }
    const tools = run.tools.map(({body, p}) => {
      const tool = new THREE.Object3D();
      tool.position.set(...p);
      return (body < 0 ? ground : bodies[body]).add(tool), tool;
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

  /// Where the tools go between 0 and end_s.
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

  /// All of a robot, side by side with others where they are not the same.
  function add(run, signal, end_s, aside, several) {
    const q = run.joints.map(joint => signal(run.number, 'q', joint));
    if (q.some(each => !each)) return null;
    const reach = run.bodies.reduce((sum, body) => sum + Math.hypot(...body.p) + Math.max(0, ...body.ends.map(end => Math.hypot(...end))) / 2, 0) || 1;
    const radius = 0.035 * reach / Math.sqrt(run.bodies.length / 2 + 1);
    const material = options => new THREE.MeshLambertMaterial(options);
    const colour = several ? run.colour : '#f08a1d';
    const robot = Object.assign(build(run, radius, material({color: colour}), material({color: '#5c6b80'})), {q, reach});
    robot.ground.position.x = aside;
    scene.add(robot.ground);
    const q_ref = run.joints.map(joint => signal(run.number, 'q_ref', joint));
    if (q_ref.every(Boolean)) {
      const ghost = material({color: '#8899aa', transparent: true, opacity: 0.6, depthWrite: false});
      robot.ghost = Object.assign(build(run, 0.85 * radius, ghost, ghost), {q: q_ref});
      robot.ground.add(robot.ghost.ground);
    }
    const path = end_s ? add_paths(robot, end_s, colour) : new THREE.Box3();
    if (!end_s) pose(robot, joint => robot.q[joint](0));
    robot.box = path.union(new THREE.Box3().setFromObject(robot.ground)).expandByScalar(end_s ? 0 : 0.15 * reach);
    return robot;
  }

  function look_at(box) {
    const centre = box.getCenter(new THREE.Vector3()), radius = box.getSize(new THREE.Vector3()).length() / 2;
    const grid = new THREE.GridHelper(4 * radius, 16, '#999999', '#999999');
    grid.rotation.x = Math.PI / 2;
    grid.material.transparent = true;
    grid.material.opacity = 0.35;
    grid.position.set(centre.x, centre.y, 0);
    scene.add(grid);
    camera.near = radius / 50;
    camera.far = 50 * radius;
    camera.position.copy(centre).addScaledVector(new THREE.Vector3(0.45, -1, 0.35).normalize(), 3.4 * radius);
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

  /// signal(run, name, joint) is a function of time, or nothing where the log has none.
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
