"use strict";
const $ = id => document.getElementById(id);
const SHOWN = {"noise.toml": "noise file", "improved.toml": "updated model", "filter.zip": "C code", "answer.json": "JSON"};
const EVERY_MS = 500;

async function ask(path, how) {
  const answer = await fetch(path, how);
  const text = await answer.text();
  let data;
  try { data = JSON.parse(text); } catch { data = {error: text || answer.statusText}; }
  if (!answer.ok || data.error) throw new Error(data.error || answer.statusText);
  return data;
}

function offer(select, key, words, chosen) {
  const option = new Option(words, key);
  select.append(option);
  if (chosen) (select.closest("select") || select).value = key;
}

function send(file) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", "/files/" + encodeURIComponent(file.name));
    request.upload.onprogress = e => { $("sent").hidden = false; $("sent").value = e.loaded / (e.total || 1); };
    request.onload = () => {
      $("sent").hidden = true;
      let data = {};
      try { data = JSON.parse(request.responseText); } catch { data = {error: request.responseText}; }
      if (data.key) resolve(data); else reject(new Error(data.error || "the file was not taken"));
    };
    request.onerror = () => { $("sent").hidden = true; reject(new Error("kfgen does not answer; is 'kfgen open' still running?")); };
    request.send(file);
  });
}

async function take(files) {
  $("wrong").textContent = "";
  for (const file of files) {
    try {
      const kept = await send(file);
      if (kept.name.endsWith(".toml")) {
        offer($("models"), kept.key, kept.name, true);
        offer($("noise"), kept.key, kept.name, false);
      } else {
        offer($("log"), kept.key, kept.name, true);
        await press("list");
      }
    } catch (error) { $("wrong").textContent = error.message; }
  }
}

async function press(action) {
  $("wrong").textContent = "";
  const given = {action};
  for (const name of ["log", "channels", "rate", "columns", "model", "noise"]) given[name] = $(name).value;
  if (action === "gap" && given.noise) given.model = given.noise;
  try {
    const job = await ask("/jobs", {method: "POST", headers: {"content-type": "application/json"}, body: JSON.stringify(given)});
    for (const open of document.querySelectorAll("#jobs details[open]")) open.open = false;
    const place = document.createElement("section");
    $("jobs").prepend(place);
    $("results").scrollIntoView();
    watch(job, place, `${action}${["audit", "emit"].includes(action) ? " of " + given.model : " of " + $("log").selectedOptions[0]?.text}`);
  } catch (error) { $("wrong").textContent = error.message; }
}

async function watch(job, place, title) {
  while (true) {
    draw(job, place, title);
    if (!["waiting", "running"].includes(job.state)) break;
    await new Promise(done => setTimeout(done, EVERY_MS));
    try { job = await ask("/jobs/" + job.id); } catch (error) { job.state = "failed"; job.said = error.message; }
  }
  for (const key of job.files) {
    const name = key.split("/")[1];
    const words = `${name} of ${title} (${key.split("/")[0]})`;
    if (name === "noise.toml") offer($("noise"), key, words, true);
    if (name === "improved.toml") for (const id of ["noise", "models"]) offer($(id), key, words, false);
  }
}

function element(name, words, more) {
  const made = Object.assign(document.createElement(name), more || {});
  if (words) made.textContent = words;
  return made;
}

function draw(job, place, title) {
  place.className = "job " + job.state;
  const parts = [element("h3", `${title}: ${job.state}`), element("code", job.command)];
  if (["waiting", "running"].includes(job.state)) {
    parts.push(element("p", job.progress || "..."), element("progress"));
    parts.push(element("button", "Stop", {onclick: () => ask("/jobs/" + job.id, {method: "DELETE"}).catch(() => {})}));
  }
  const links = element("p", "", {className: "links"});
  for (const key of job.files) {
    const name = key.split("/")[1];
    if (name === "report.html") links.append(element("a", "report", {href: "/files/" + key, target: "_blank", rel: "noopener"}));
    else links.append(element("a", SHOWN[name] || name, {href: "/files/" + key, download: name}));
  }
  if (job.files.length) parts.push(links);
  if (job.said) parts.push(fold(job.state === "failed" ? "What is wrong" : "Warnings", element("pre", job.said), job.state === "failed"));
  if (job.answer) parts.push(fold("Answer", element("pre", job.answer), false));
  const asked = job.state === "failed" && job.said.match(/--columns '([^']+)'/);
  if (asked) parts.push(element("button", `Read it with ${asked[1]}`, {onclick: () => { $("columns").value = asked[1]; press("list"); }}));
  const report = job.files.find(key => key.endsWith("/report.html"));
  if (report) parts.push(fold("Report", element("iframe", "", {src: "/files/" + report, title: title}), true));
  place.replaceChildren(...parts);
}

function fold(words, content, open) {
  const made = element("details", "", {open});
  made.append(element("summary", words), content);
  return made;
}

$("choose").onchange = e => take([...e.target.files]).then(() => { e.target.value = ""; });
for (const name of ["dragenter", "dragover"]) addEventListener(name, e => { e.preventDefault(); $("drop").classList.add("over"); });
for (const name of ["dragleave", "drop"]) addEventListener(name, e => { e.preventDefault(); $("drop").classList.remove("over"); });
addEventListener("drop", e => take([...e.dataTransfer.files]));
for (const button of document.querySelectorAll("button[data-action]")) button.onclick = () => press(button.dataset.action);
