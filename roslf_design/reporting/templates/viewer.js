// Scenes in 3D that can be turned, by WebGL2: bodies lit from the viewer, translucent ones from the back to the front.
(() => {
  const VERTEX = `#version 300 es
    in vec3 here, there;
    in float side;
    uniform mat3 turn;
    uniform vec3 focus;
    uniform vec2 scale, size;
    uniform float width, depth;
    out vec3 place;
    void main() {
      vec2 along = (turn * (there - here)).xy * scale * size;
      vec2 aside = side == 0.0 || along == vec2(0) ? vec2(0) : side * width * normalize(vec2(-along.y, along.x)) / size;
      place = turn * (here - focus);
      gl_Position = vec4(place.xy * scale + aside, -place.z / depth, 1);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 place;
    uniform vec4 colour;
    uniform bool lit;
    out vec4 shown;
    void main() {
      vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
      float light = 0.45 + 0.33 * abs(normal.z) + 0.27 * abs(dot(normal, normalize(vec3(0.4, 0.8, 0.5))));
      shown = vec4(colour.rgb * (lit ? light : 1.0), 1) * colour.a;
    }`;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const along = (a, b, t) => a.map((v, i) => v + t * b[i]);
  const unit = a => a.map(v => v / Math.hypot(...a));

  const unpacked = async text => {
    const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).json();
  };

  // Lists of cells: a number of corners, then their indices.
  const cells = list => {
    const found = [];
    for (let i = 0; i < list.length; i += list[i] + 1) found.push(list.slice(i + 1, i + 1 + list[i]));
    return found;
  };

  // Corners of triangles, each with the other end of its line, and on which side of the line it lies; 0 on surfaces.
  const corners = mesh => {
    const point = i => mesh.points.slice(3 * i, 3 * i + 3), made = [];
    for (const [first, ...rest] of cells(mesh.polys))
      for (let k = 1; k < rest.length; k++)
        for (const i of [first, rest[k - 1], rest[k]]) made.push(...point(i), ...point(i), 0);
    for (const line of cells(mesh.lines))
      for (let k = 1; k < line.length; k++) {
        const a = point(line[k - 1]), b = point(line[k]);
        for (const [one, other, side] of [[a, b, 1], [a, b, -1], [b, a, 1], [b, a, 1], [b, a, -1], [a, b, 1]])
          made.push(...one, ...other, side);
      }
    return new Float32Array(made);
  };

  class View {
    constructor(canvas, scene, moved) {
      this.canvas = canvas;
      this.moved = moved;
      this.start = scene.camera;
      const gl = this.gl = canvas.getContext("webgl2", { antialias: true });
      const program = this.program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      gl.useProgram(program);
      this.parts = scene.meshes.filter(mesh => mesh.points.length).map(mesh => {
        const data = corners(mesh), middle = [0, 0, 0], array = gl.createVertexArray();
        for (let i = 0; i < mesh.points.length; i++) middle[i % 3] += 3 * mesh.points[i] / mesh.points.length;
        gl.bindVertexArray(array);
        gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
        for (const [name, count, offset] of [["here", 3, 0], ["there", 3, 12], ["side", 1, 24]]) {
          const at = gl.getAttribLocation(program, name);
          gl.enableVertexAttribArray(at);
          gl.vertexAttribPointer(at, count, gl.FLOAT, false, 28, offset);
        }
        return { ...mesh, middle, array, count: data.length / 7 };
      });
      this.far = 2 * Math.max(...scene.meshes.flatMap(mesh => mesh.points.map(Math.abs)));
      const fingers = new Map();
      canvas.addEventListener("pointerdown", event => {
        canvas.setPointerCapture(event.pointerId);
        fingers.set(event.pointerId, [event.clientX, event.clientY]);
      });
      for (const name of ["pointerup", "pointercancel"])
        canvas.addEventListener(name, event => fingers.delete(event.pointerId));
      canvas.addEventListener("pointermove", event => {
        const last = fingers.get(event.pointerId);
        if (!last) return;
        const now = [event.clientX, event.clientY], by = [now[0] - last[0], now[1] - last[1]];
        const other = [...fingers].find(([id]) => id !== event.pointerId);
        fingers.set(event.pointerId, now);
        if (other) this.near(Math.hypot(last[0] - other[1][0], last[1] - other[1][1]) / Math.hypot(now[0] - other[1][0], now[1] - other[1][1]));
        else if (event.shiftKey || event.buttons & 4) this.shift(...by);
        else this.rotate(...by);
      });
      canvas.addEventListener("wheel", event => {
        event.preventDefault();
        this.near(Math.exp(0.0015 * event.deltaY));
      }, { passive: false });
      new ResizeObserver(() => this.draw()).observe(canvas);
      this.look();
    }

    look(toward, up) {
      this.focus = this.start.focalPoint;
      this.toward = unit(toward || along(this.start.position, this.focus, -1));
      this.up = up || this.start.viewUp;
      this.scale = 1;
      this.draw();
    }

    near(factor) {
      this.scale *= factor;
      this.draw();
    }

    shift(x, y) {
      const mm = 2 * this.half() / this.canvas.clientHeight, [right, up] = this.axes();
      this.focus = along(along(this.focus, right, -mm * x), up, mm * y);
      this.draw();
    }

    rotate(x, y) {
      const angle = Math.PI / this.canvas.clientWidth, [right, up, toward] = this.axes();
      this.toward = unit(along(along(toward, right, -angle * x), up, angle * y));
      this.up = unit(along(up, this.toward, -dot(up, this.toward)));
      this.draw();
    }

    axes() {
      const right = unit(cross(this.up, this.toward));
      return [right, cross(this.toward, right), this.toward];
    }

    // Half the height that is seen [mm]: all of the instrument's length has room.
    half() {
      const { clientWidth: wide, clientHeight: high } = this.canvas;
      return this.scale * Math.max(this.start.parallelScale, this.start.halfWidth * high / wide);
    }

    // From the left and from above, as shares of the view.
    seen(point) {
      const [right, up] = this.axes(), from = along(point, this.focus, -1), high = 2 * this.half();
      const wide = high * this.canvas.clientWidth / this.canvas.clientHeight;
      return [0.5 + dot(from, right) / wide, 0.5 - dot(from, up) / high];
    }

    draw() {
      const { gl, program, canvas } = this, dense = window.devicePixelRatio || 1;
      const set = (name, kind, ...values) => gl[`uniform${kind}`](gl.getUniformLocation(program, name), ...values);
      canvas.width = dense * canvas.clientWidth;
      canvas.height = dense * canvas.clientHeight;
      if (!canvas.width || !canvas.height) return;
      const axes = this.axes(), high = this.half();
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(1, 1, 1, 1);
      gl.depthMask(true);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      set("turn", "Matrix3fv", true, axes.flat());
      set("focus", "3fv", this.focus);
      set("scale", "2f", canvas.height / (high * canvas.width), 1 / high);
      set("size", "2f", canvas.width, canvas.height);
      set("depth", "1f", 2 * this.far);
      const order = part => part.opacity < 1 ? dot(part.middle, this.toward) : -Infinity;
      for (const part of [...this.parts].sort((a, b) => order(a) - order(b))) {
        gl.depthMask(part.opacity === 1);
        set("colour", "4f", ...part.colour, part.opacity);
        set("lit", "1i", part.polys.length ? 1 : 0);
        set("width", "1f", dense * part.width);
        gl.bindVertexArray(part.array);
        gl.drawArrays(gl.TRIANGLES, 0, part.count);
      }
      this.moved(this);
    }
  }

  const element = (kind, name, text = "") => Object.assign(document.createElement(kind), { className: name, textContent: text });
  const button = (text, act) => {
    const made = element("button", "", text);
    made.type = "button";
    made.addEventListener("click", act);
    return made;
  };

  for (const figure of document.querySelectorAll("figure[data-scene]")) {
    const still = figure.querySelector(".drawing"), bar = element("div", "turn"), hint = element("span", "hint");
    hint.setAttribute("role", "status");
    let live = null;

    const open = async () => {
      if (!("DecompressionStream" in window) || !element("canvas").getContext("webgl2")) {
        hint.textContent = "This browser offers no WebGL2, so the picture stays as it is.";
        return;
      }
      const scene = await unpacked(document.getElementById(figure.dataset.scene).textContent);
      const canvas = element("canvas"), names = element("div", "names");
      const spans = scene.names.map(name => element("span", "", name.text));
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", figure.querySelector("h3").textContent);
      names.setAttribute("aria-hidden", "true");
      names.append(...spans);
      live = element("div", "live");
      live.style.height = `${Math.max(still.getBoundingClientRect().height, 320)}px`;
      live.append(canvas, names);
      still.after(live);
      still.style.display = "none";
      const view = new View(canvas, scene, view => {
        const taken = [];
        scene.names.forEach((name, i) => {
          const [left, top] = view.seen(name.at), x = left * canvas.clientWidth, y = top * canvas.clientHeight;
          const half = spans[i].offsetWidth / 2;
          const hidden = taken.some(other => Math.abs(other.y - y) < 18 && Math.abs(other.x - x) < half + other.half);
          Object.assign(spans[i].style, { left: `${x}px`, top: `${y}px`, visibility: hidden ? "hidden" : "visible" });
          if (!hidden) taken.push({ x, y, half });
        });
      });
      hint.textContent = "Drag to turn, wheel to come nearer, shift and drag to move.";
      bar.replaceChildren(
        button("As in the picture", () => view.look()),
        button("From the side", () => view.look([-1, 0, 0], [0, 1, 0])),
        button("From the object", () => view.look([0, 0, -1], [0, 1, 0])),
        button("Back to the picture", close),
        hint,
      );
      figure.dataset.turned = "yes";
    };

    const close = () => {
      live.remove();
      still.style.display = "";
      hint.textContent = "";
      delete figure.dataset.turned;
      bar.replaceChildren(start, hint);
    };

    const start = button("Turn it in 3D", open);
    bar.append(start, hint);
    still.after(bar);
  }
})();
