// Live or replay: what the console looks at, and the logs it could look at.

import { useState } from "react";

import { fileSize } from "../../lib/format";
import { formatDayTime, formatSpan, parseOptional } from "../../lib/time";
import { useConsole } from "../../store/console";
import { backToLive, loadLogs, openLog, useLogs } from "../../store/replay";
import { useView } from "../../store/view";
import type { LogInfo } from "../../api/types";
import { Popover } from "../../ui/Popover";

export function ModeMenu() {
  const replay = useConsole((s) => s.stream.replayState);
  const simulated = useConsole((s) => s.simulated);
  const label = (
    <>
      <span className={replay ? "mode-tag replay" : "mode-chip"} data-testid="mode">
        {replay ? "REPLAY" : "LIVE"}
      </span>
      {simulated && <span className="mode-tag">SIM</span>}
    </>
  );
  return (
    <Popover label={label} title="Live rover or a flight log" testId="mode-menu">
      {(close) => <Menu close={close} replaying={replay !== null} />}
    </Popover>
  );
}

function Menu({ close, replaying }: { close: () => void; replaying: boolean }) {
  const { logs, failure, busy } = useLogs();
  const [asked, setAsked] = useState(false);
  if (!asked) {
    setAsked(true);
    void loadLogs();
  }
  return (
    <>
      {replaying && (
        <div className="section">
          <button
            type="button"
            className="button primary"
            onClick={() => {
              close();
              void backToLive();
            }}
          >
            Back to live
          </button>
        </div>
      )}
      <div className="section stack">
        <h2>Flight logs</h2>
        {failure && <p className="trouble small">{failure}</p>}
        {logs === null && !failure && <p className="quiet">Looking for logs…</p>}
        {logs?.length === 0 && <p className="quiet">There are no logs yet.</p>}
        <ul className="log-list">
          {logs?.map((log) => (
            <LogRow
              key={log.id}
              log={log}
              disabled={busy}
              open={() => {
                close();
                void openLog(log.id);
              }}
            />
          ))}
        </ul>
      </div>
      <OperatorField />
    </>
  );
}

function LogRow({ log, disabled, open }: { log: LogInfo; disabled: boolean; open: () => void }) {
  const start = parseOptional(log.start);
  const end = parseOptional(log.end);
  return (
    <li className="log-row">
      <div>
        <div className="num">{start === null ? log.id : formatDayTime(start)}</div>
        <div className="quiet small">
          {start !== null && end !== null ? formatSpan((end - start) / 1000) : "empty"} ·{" "}
          {log.messages} messages · {fileSize(log.size)}
          {log.open && " · being written"}
        </div>
      </div>
      <button
        type="button"
        className="button"
        data-testid={`replay-${log.id}`}
        disabled={disabled}
        aria-label={`Replay ${log.id}`}
        onClick={open}
      >
        Replay
      </button>
    </li>
  );
}

function OperatorField() {
  const operator = useView((s) => s.operator);
  return (
    <label className="section field">
      Your name, told with each request
      <input
        type="text"
        maxLength={40}
        value={operator}
        onChange={(event) => useView.setState({ operator: event.target.value })}
      />
    </label>
  );
}
