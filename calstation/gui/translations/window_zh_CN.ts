<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>ChecksTable</name>
    <message>
        <source>Check</source>
        <translation>检查项</translation>
    </message>
    <message>
        <source>Where</source>
        <translation>位置</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>Value</source>
        <translation>值</translation>
    </message>
    <message>
        <source>Limit</source>
        <translation>限差</translation>
    </message>
    <message>
        <source>Margin</source>
        <translation>余量</translation>
    </message>
    <message>
        <source>Verdict</source>
        <translation>结论</translation>
    </message>
    <message>
        <source>Checks of the result</source>
        <translation>结果的检查项</translation>
    </message>
</context>
<context>
    <name>JobRow</name>
    <message>
        <source>Cancel</source>
        <extracomment>Interval between two polls of a job, ms. Fraction from which the time left is shown.</extracomment>
        <translation>取消</translation>
    </message>
    <message>
        <source>waiting for other work</source>
        <translation>等待其他任务完成</translation>
    </message>
    <message>
        <source>{0} left</source>
        <translation>剩余 {0}</translation>
    </message>
</context>
<context>
    <name>MainWindow</name>
    <message>
        <source>STOP</source>
        <extracomment>Height of the strip with STOP at the top of every page, px.</extracomment>
        <translation>停止</translation>
    </message>
    <message>
        <source>Stops the run safely; Esc does the same. It is no emergency stop.</source>
        <translation>安全停止本次标定，按 Esc 键同样有效。这不是急停按钮。</translation>
    </message>
    <message>
        <source>Light or dark</source>
        <translation>浅色或深色</translation>
    </message>
    <message>
        <source>Engineer</source>
        <translation>工程师</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Lock: back to the operator&apos;s role</source>
        <translation>锁定，回到操作员身份</translation>
    </message>
    <message>
        <source>Unlock with the engineer&apos;s PIN</source>
        <translation>用工程师密码解锁</translation>
    </message>
    <message>
        <source>no station</source>
        <translation>无工位</translation>
    </message>
    <message>
        <source>virtual bench</source>
        <translation>虚拟台架</translation>
    </message>
    <message>
        <source>Table and unit are simulated: nothing moves.</source>
        <translation>转台和产品均为模拟，设备不会实际运动。</translation>
    </message>
</context>
<context>
    <name>ResetBar</name>
    <message>
        <source>Reset the fault</source>
        <translation>复位故障</translation>
    </message>
    <message>
        <source>A run is going on; reset when it has ended.</source>
        <translation>标定正在进行，结束后再复位。</translation>
    </message>
    <message>
        <source>Clears what the table has latched. Nothing moves and no axis is switched on.</source>
        <translation>清除转台锁存的故障。转台不会转动，轴也不会上电。</translation>
    </message>
    <message>
        <source>Asking the table.</source>
        <translation>正在询问转台。</translation>
    </message>
    <message>
        <source>No fault is latched.</source>
        <translation>转台没有锁存故障。</translation>
    </message>
    <message>
        <source>The fault “{latched}” was reset; nothing is latched now.</source>
        <translation>故障“{latched}”已复位，转台现在没有锁存故障。</translation>
    </message>
    <message>
        <source>Not reset: the interlock is open. Close the cover, then press again (latched: “{latched}”).</source>
        <translation>未复位：安全联锁断开。请关好防护罩，再按一次（锁存的故障：“{latched}”）。</translation>
    </message>
    <message>
        <source>Not reset: the table still turns. Wait until it rests, then press again (latched: “{latched}”).</source>
        <translation>未复位：转台仍在转动。请等它静止，再按一次（锁存的故障：“{latched}”）。</translation>
    </message>
    <message>
        <source>Not reset: the table is under local control. Switch it to remote control at its panel.</source>
        <translation>未复位：转台处于本地控制。请在转台面板上切换到远程控制。</translation>
    </message>
    <message>
        <source>The table refuses the reset of “{latched}” ({words}). Remove the cause first.</source>
        <translation>转台拒绝复位“{latched}”（{words}）。请先排除原因。</translation>
    </message>
    <message>
        <source>“{latched}” was reset, but “{left}” is there now: its cause is still there. Remove it first.</source>
        <translation>已复位“{latched}”，但现在仍有故障“{left}”：原因还在。请先排除原因。</translation>
    </message>
</context>
<context>
    <name>RolePanel</name>
    <message>
        <source>Choose the engineer&apos;s PIN</source>
        <translation>设置工程师密码</translation>
    </message>
    <message>
        <source>Engineer</source>
        <translation>工程师</translation>
    </message>
    <message>
        <source>No PIN has been set here yet. At least four characters; it opens what changes results.</source>
        <translation>本机还没有设置密码。至少四个字符，用来开放会影响结果的设置。</translation>
    </message>
    <message>
        <source>The PIN opens settings that change results, and registers.</source>
        <translation>密码开放会影响结果的设置和寄存器操作。</translation>
    </message>
    <message>
        <source>new PIN</source>
        <translation>新密码</translation>
    </message>
    <message>
        <source>PIN</source>
        <translation>密码</translation>
    </message>
    <message>
        <source>The two PINs differ.</source>
        <translation>两次输入不一致。</translation>
    </message>
    <message>
        <source>the same again</source>
        <extracomment>Interval at which the time to wait is updated, ms.</extracomment>
        <translation>再输一遍</translation>
    </message>
    <message>
        <source>Set PIN</source>
        <translation>设置密码</translation>
    </message>
    <message>
        <source>Unlock</source>
        <translation>解锁</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>The PIN is wrong.</source>
        <translation>密码不对。</translation>
    </message>
    <message>
        <source>Wait {seconds:.0f} s.</source>
        <translation>请等 {seconds:.0f} 秒。</translation>
    </message>
</context>
<context>
    <name>RunStrip</name>
    <message>
        <source>{time} left</source>
        <translation>剩余 {time}</translation>
    </message>
</context>
<context>
    <name>faults</name>
    <message>
        <source>Table</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>IMU</source>
        <translation>惯组</translation>
    </message>
    <message>
        <source>Virtual bench</source>
        <translation>虚拟台</translation>
    </message>
    <message>
        <source>Program</source>
        <translation>程序</translation>
    </message>
    <message>
        <source>Configuration</source>
        <translation>配置</translation>
    </message>
    <message>
        <source>Data</source>
        <translation>数据</translation>
    </message>
    <message>
        <source>table: the interlock is open; close the cover and start again</source>
        <translation>转台：安全联锁断开；请关好防护罩，再重新开始</translation>
    </message>
    <message>
        <source>table: the interlock was opened; close the cover and start again</source>
        <translation>转台：运行中安全联锁被断开；请关好防护罩，再重新开始</translation>
    </message>
    <message>
        <source>table: the watchdog is off (0); set its timeout in the drive, e.g. 1000 ms, before any run</source>
        <translation>转台：看门狗未启用（0）；标定前请在驱动器里设置超时，例如 1000 ms</translation>
    </message>
    <message>
        <source>table: the axes are not enabled; check the drive&apos;s enable input</source>
        <translation>转台：轴没有使能；请检查驱动器的使能输入</translation>
    </message>
    <message>
        <source>table: the axes are not homed; home the table first</source>
        <translation>转台：轴还没有回零；请先让转台回零</translation>
    </message>
    <message>
        <source>table: the drive switched the axes off; look at the drive&apos;s display</source>
        <translation>转台：驱动器自行断开了轴使能；请查看驱动器面板</translation>
    </message>
    <message>
        <source>table: the drive does not enable its axes</source>
        <translation>转台：驱动器无法使能各轴；请检查驱动器的使能输入</translation>
    </message>
    <message>
        <source>table: does not come to rest after a stop command</source>
        <translation>转台：发出停止命令后没有停下来；请立即查看转台</translation>
    </message>
    <message>
        <source>table: homing did not end within {0} s; check the home switches</source>
        <translation>转台：{0} s 内没有完成回零；请检查零位开关</translation>
    </message>
    <message>
        <source>table: did not reach outer {0}°, inner {1}° in time; look for an obstacle or a stalled drive</source>
        <translation>转台：没有按时转到外框 {0}°、内框 {1}°；请检查有无障碍物，或驱动器是否堵转</translation>
    </message>
    <message>
        <source>table: port {0} cannot be opened; check cable, power and the port in the station file</source>
        <translation>转台：端口 {0} 打不开；请检查电缆、电源和工位文件中的端口</translation>
    </message>
    <message>
        <source>table: it and the IMU are exchanged, its port {0} is the IMU&apos;s; exchange table.port and imu.port in the station file</source>
        <translation>转台：转台与 IMU 的端口填反了，{0} 接的是 IMU；请在工位文件中对调 table.port 和 imu.port</translation>
    </message>
    <message>
        <source>table: on {0} &apos;{1}&apos; answers as unit {2}, not as unit {3}; correct table.unit in the station file</source>
        <translation>转台：{0} 上“{1}”以站号 {2} 应答，而不是 {3}；请改正工位文件中的 table.unit</translation>
    </message>
    <message>
        <source>table: asked for its model as unit {0} on {1}, it refuses: {2} (Modbus exception {3}); check the unit number, then look at the drive&apos;s display</source>
        <translation>转台：在 {1} 上以站号 {0} 询问型号被拒绝：{2}（Modbus 异常码 {3}）；请检查站号，再看驱动器的显示</translation>
    </message>
    <message>
        <source>table: nothing answers in Modbus on {0} as unit {1}; check cable, power and unit number, and whether it is the table that is connected there</source>
        <translation>转台：{0} 上没有设备以站号 {1} 作 Modbus 应答；请检查电缆、电源和站号，并确认那里接的确实是转台</translation>
    </message>
    <message>
        <source>table: nothing answers in Modbus on {0} as unit {1}; check cable, power, baud, parity and unit number, and whether it is the table that is connected there</source>
        <translation>转台：{0} 上没有设备以站号 {1} 作 Modbus 应答；请检查电缆、电源、波特率、校验位和站号，并确认那里接的确实是转台</translation>
    </message>
    <message>
        <source>table: port {0} cannot be opened: nobody knows this host; correct its name in the station file, or give its IP address</source>
        <translation>转台：端口 {0} 打不开：找不到这台主机；请改正工位文件中的主机名，或填写 IP 地址</translation>
    </message>
    <message>
        <source>table: port {0} cannot be opened: the host is there but serves nothing at this port; correct the port number in the station file, see that the device&apos;s server is on</source>
        <translation>转台：端口 {0} 打不开：主机在线，但该端口没有服务；请改正工位文件中的端口号，并确认设备的服务已开启</translation>
    </message>
    <message>
        <source>table: port {0} cannot be opened: no answer within {1} s; check power, network cable and the IP address in the station file</source>
        <translation>转台：端口 {0} 打不开：{1} 秒内没有应答；请检查电源、网线和工位文件中的 IP 地址</translation>
    </message>
    <message>
        <source>table: port {0} cannot be opened ({1}); {2}</source>
        <translation>转台：端口 {0} 打不开（{1}）；{2}</translation>
    </message>
    <message>
        <source>table: model &apos;{0}&apos; answers, the profile is for &apos;{1}&apos;; choose the right table profile in the station file</source>
        <translation>转台：应答的型号是“{0}”，配置文件对应“{1}”；请在工位文件中选择正确的转台配置</translation>
    </message>
    <message>
        <source>IMU: model &apos;{0}&apos; answers, the profile is for &apos;{1}&apos;; choose the right IMU profile in the product file</source>
        <translation>IMU：应答的型号是“{0}”，配置文件对应“{1}”；请在产品文件中选择正确的 IMU 配置</translation>
    </message>
    <message>
        <source>IMU: no data; check port, baud and power</source>
        <translation>惯组：没有数据；请检查端口、波特率和电源</translation>
    </message>
    <message>
        <source>IMU: {0} shows the same value all the time; switch the unit off and on, replace it where that does not help</source>
        <translation>惯组：{0} 一直输出同一个值；请断电重启产品，仍无效则更换</translation>
    </message>
    <message>
        <source>IMU: no data any more; check cable, power and port</source>
        <translation>惯组：数据中断；请检查电缆、电源和端口</translation>
    </message>
    <message>
        <source>IMU: no data during a turn; check cable, power and port</source>
        <translation>惯组：转动时没有数据；请检查电缆、电源和端口</translation>
    </message>
    <message>
        <source>IMU: samples are lost again and again; check cable, baud and the load of this computer</source>
        <translation>惯组：反复丢数；请检查电缆、波特率和本机负荷</translation>
    </message>
    <message>
        <source>IMU: the output saturates in this step; lower the rate in the product&apos;s schedule</source>
        <translation>惯组：这一步输出饱和；请在产品流程中降低转速</translation>
    </message>
    <message>
        <source>IMU: {0} s of data did not come in time; check the link and the sample rate</source>
        <translation>惯组：没有按时收到 {0} s 的数据；请检查链路和采样率</translation>
    </message>
    <message>
        <source>IMU: no data any more, and the unit does not answer either; check its power, cable and port</source>
        <translation>惯组：数据中断，产品也无应答；请检查其电源、电缆和端口</translation>
    </message>
    <message>
        <source>IMU: not ready {0} s after its restart; switch it off and on</source>
        <translation>惯组：重启 {0} s 后仍未就绪；请给产品断电重启</translation>
    </message>
    <message>
        <source>IMU: it restarts again and again; check its supply, plug and cable, then start again</source>
        <translation>惯组：反复重启；请检查其供电、插头和电缆，然后重新开始</translation>
    </message>
    <message>
        <source>IMU: it restarted while its output was looked at; check its supply, plug and cable, then start again</source>
        <translation>惯组：检查其输出时产品重启；请检查其供电、插头和电缆，然后重新开始</translation>
    </message>
    <message>
        <source>IMU: it restarted while its new registers were looked at; check its supply, plug and cable, then start again and finish or restore them</source>
        <translation>惯组：检查新写入的寄存器时产品重启；请检查其供电、插头和电缆，然后重新开始，选择写完或恢复</translation>
    </message>
    <message>
        <source>IMU: no rest without a gap within {0} s of its restart; check cable, power and port</source>
        <translation>惯组：重启后 {0} s 内没有一段不丢数的静止数据；请检查电缆、电源和端口</translation>
    </message>
    <message>
        <source>IMU: the unit answers to serial number &apos;{0}&apos;, not &apos;{1}&apos;; check the unit in the fixture and the number given</source>
        <translation>惯组：产品回答的编号是“{0}”，不是“{1}”；请核对夹具上的产品和输入的编号</translation>
    </message>
    <message>
        <source>IMU: not ready after {0} s; check power, port, baud and parity</source>
        <translation>惯组：{0} s 后仍未就绪；请检查电源、端口、波特率和校验位</translation>
    </message>
    <message>
        <source>IMU: the unit reports a failed self-test; replace the unit</source>
        <translation>惯组：产品自检不通过；请更换产品</translation>
    </message>
    <message>
        <source>IMU: gyro {0} measures {1} °/s at rest, expected {2} to {3} °/s; replace the unit, or correct prior.gyro_bias in the IMU profile</source>
        <translation>惯组：静止时陀螺 {0} 测得 {1} °/s，预期 {2} 至 {3} °/s；请更换产品，或改正惯组文件中的 prior.gyro_bias</translation>
    </message>
    <message>
        <source>IMU: temperature still drifts by {0} °C/min after {1} s; wait, or allow more in the product&apos;s warm_up</source>
        <translation>惯组：{1} s 后温度仍以 {0} °C/min 变化；请再等一等，或放宽产品的预热条件（warm_up）</translation>
    </message>
    <message>
        <source>IMU: data have gaps already at rest; check cable, baud and sample rate</source>
        <translation>惯组：静止时就有丢数；请检查电缆、波特率和采样率</translation>
    </message>
    <message>
        <source>IMU: gravity measures {0} m/s², expected {1} m/s²; check the IMU profile&apos;s accel_lsb and output, and the unit</source>
        <translation>惯组：测得重力 {0} m/s²，应为 {1} m/s²；请检查惯组配置里的 accel_lsb 和 output，以及产品本身</translation>
    </message>
    <message>
        <source>IMU: gravity points {0}° away from the declared mounting; check how the unit is mounted and the table profile&apos;s axes</source>
        <translation>惯组：重力方向与声明的安装方式相差 {0}°；请检查产品的安装和转台配置中的轴向</translation>
    </message>
    <message>
        <source>IMU: a turn of the {0} axis measures {1}° away from the declared axis; check how the unit is mounted and the table profile&apos;s axes</source>
        <translation>惯组：{0} 轴转动时测得的转轴与声明的相差 {1}°；请检查产品的安装和转台配置中的轴向</translation>
    </message>
    <message>
        <source>IMU: a turn of {0}° of the {1} axis measures {2}° about it; check axes, mounting and gyro_lsb</source>
        <translation>惯组：{1} 轴转了 {0}°，陀螺测得 {2}°；请检查轴向、安装和 gyro_lsb</translation>
    </message>
    <message>
        <source>IMU: port {0} cannot be opened ({1}); {2}</source>
        <translation>惯组：端口 {0} 打不开（{1}）；{2}</translation>
    </message>
    <message>
        <source>IMU: no answer on {0} within {1} s, not a byte came; check power, cable and port</source>
        <translation>惯组：{0} 在 {1} s 内没有应答，一个字节也没收到；请检查电源、电缆和端口</translation>
    </message>
    <message>
        <source>IMU: bytes come on {0} but no frame is recognised; check baud, parity, stop bits and the IMU profile</source>
        <translation>惯组：{0} 上有字节，但识别不出数据帧；请检查波特率、校验位、停止位和惯组配置</translation>
    </message>
    <message>
        <source>IMU: {0} = {1} does not fit register {2} ({3} to {4}); nothing was written</source>
        <translation>惯组：{0} = {1} 超出寄存器 {2} 的范围（{3} 到 {4}）；没有写入任何内容</translation>
    </message>
    <message>
        <source>IMU: the unit refused to commit its registers; power it off and on, try again</source>
        <translation>惯组：产品拒绝保存寄存器；请断电重启后再试</translation>
    </message>
    <message>
        <source>IMU: its old registers are back, but with them {0} measures {1}, expected {2} within {3}; calibrate the unit before it is used</source>
        <translation>惯组：旧寄存器已恢复，但用它们 {0} 实测 {1}，应为 {2}，允差 {3}；产品使用前请先标定</translation>
    </message>
    <message>
        <source>table: its {0} axis cannot turn by {1}° to either side, so no turn can prove the unit&apos;s output; widen its travel</source>
        <translation>转台：{0} 轴向两侧都转不了 {1}°，无法用转动验证产品输出；请放宽行程</translation>
    </message>
    <message>
        <source>IMU: unit &apos;{0}&apos; is in the fixture, the values are for &apos;{1}&apos;; nothing was written; change the unit or open its own result</source>
        <translation>惯组：夹具上的产品是 {0}，数值属于 {1}，没有写入任何内容；请更换产品，或打开它自己的结果</translation>
    </message>
    <message>
        <source>IMU: the unit makes of its new registers something else than they mean: {0} {1}, at most {2}; its old registers were put back; look whether the table was disturbed, and correct the IMU profile&apos;s convention, sign, order and places of the registers; then run again</source>
        <translation>IMU：本机按新寄存器的输出与其含义不符：{0} 为 {1}，允许 {2}；已恢复原寄存器；请检查转台是否受扰动，并改正 IMU 配置中寄存器的约定、符号、行列顺序和位置，然后重新运行</translation>
    </message>
    <message>
        <source>site.latitude_deg = {0} in the station file, but the unit&apos;s gyros see the earth turn as at {1}° (sigma {2}°); correct latitude and gravity of the place, or look at the gyros where another unit agrees with the file</source>
        <translation>台站文件中 site.latitude_deg = {0}，但产品陀螺测得的地球自转对应纬度 {1}°（标准差 {2}°）；请改正台站的纬度和重力，若另一产品与文件一致则检查本产品的陀螺</translation>
    </message>
    <message>
        <source>{0}: site.gravity_mps2 is missing, and gyros of this grade do not feel the earth turn: a wrong latitude would show nowhere; add the gravity surveyed at the place, from a gravity net or a gravimeter</source>
        <translation>{0}：缺少 site.gravity_mps2，这一等级的陀螺感受不到地球自转，纬度填错将无从发现；请填写当地实测重力（取自重力网或重力仪）</translation>
    </message>
    <message>
        <source>{0}: site.gravity_mps2 = {1} does not belong to latitude {2}° and height {3} m, where normal gravity is {4}; correct gravity, latitude or height</source>
        <translation>{0}：site.gravity_mps2 = {1} 与纬度 {2}°、高度 {3} m 不符，该处正常重力为 {4}；请改正重力、纬度或高度</translation>
    </message>
    <message>
        <source>table: registers {0}-{1} cannot be read on {2} ({3}); check cable, power and unit number</source>
        <translation>转台：读不到 {2} 上的寄存器 {0}-{1}（{3}）；请检查电缆、电源和站号</translation>
    </message>
    <message>
        <source>table: register {0} cannot be written on {1} ({2}); check cable, power and unit number</source>
        <translation>转台：写不进 {1} 上的寄存器 {0}（{2}）；请检查电缆、电源和站号</translation>
    </message>
    <message>
        <source>table: registers {0}-{1} cannot be read: {2}; {3}</source>
        <translation>转台：读不到寄存器 {0}-{1}：{2}；{3}</translation>
    </message>
    <message>
        <source>table: register {0} cannot be written: {1}; {2}</source>
        <translation>转台：写不进寄存器 {0}：{1}；{2}</translation>
    </message>
    <message>
        <source>table: registers.{0} ({1}) holds no number; check its address, type and word_order in the table profile</source>
        <translation>转台：registers.{0}（{1}）中不是有效数值；请检查转台配置中它的 address、type 和 word_order</translation>
    </message>
    <message>
        <source>table: &apos;{0}&apos; is refused with &apos;{1}&apos;; look at the table&apos;s display, then compare this line of the table profile with the controller&apos;s manual</source>
        <translation>转台：命令“{0}”被拒绝，回复为“{1}”；请查看转台的显示，再对照控制器手册核对转台配置中的这一行</translation>
    </message>
    <message>
        <source>table: &apos;{0}&apos; answers on {1} where &apos;{2}&apos; did; nothing was told to it; check which adapter is plugged in where</source>
        <translation>转台：现在 {1} 上应答的是“{0}”，之前是“{2}”；没有向它发送任何命令，请检查各个转接器插在哪里</translation>
    </message>
    <message>
        <source>table: &apos;{0}&apos; is answered with &apos;{1}&apos;, which queries.{2} of the profile does not expect; correct its answer</source>
        <translation>转台：查询“{0}”的应答“{1}”不符合转台配置中的 queries.{2}；请改正它的 answer</translation>
    </message>
    <message>
        <source>table: &apos;{0}&apos; is no number; correct the query&apos;s answer in the table profile</source>
        <translation>转台：应答“{0}”不是数值；请改正转台配置中该查询的 answer</translation>
    </message>
    <message>
        <source>table: &apos;{0}&apos; is no number of base {1}; correct the flags</source>
        <translation>转台：“{0}”不是 {1} 进制数；请改正转台配置中的 flags</translation>
    </message>
    <message>
        <source>IMU: register {0} is refused: {1}; {2}</source>
        <translation>惯组：寄存器 {0} 拒绝访问：{1}；{2}</translation>
    </message>
    <message>
        <source>IMU: command &apos;{0}&apos; was refused: {1}; {2}</source>
        <translation>惯组：命令“{0}”被拒绝：{1}；{2}</translation>
    </message>
    <message>
        <source>IMU: &apos;{0}&apos; was refused: {1}; {2}</source>
        <translation>惯组：命令“{0}”被拒绝：{1}；{2}</translation>
    </message>
    <message>
        <source>IMU: register {0} answers &apos;{1}&apos;, not {2} numbers; compare it with the unit&apos;s manual, and correct address or parameters in the IMU profile</source>
        <translation>惯组：寄存器 {0} 的应答“{1}”不是 {2} 个数；请对照产品手册，改正惯组配置中的 address 或 parameters</translation>
    </message>
    <message>
        <source>IMU: register {0} answers with {1} bytes, not {2}; check its type and parameters in the IMU profile</source>
        <translation>惯组：寄存器 {0} 的应答有 {1} 字节，应为 {2} 字节；请检查惯组配置中它的 type 和 parameters</translation>
    </message>
    <message>
        <source>IMU: register {0} was not taken, nothing was committed; look at the unit&apos;s supply and write protection, then check this register in the IMU profile</source>
        <translation>惯组：寄存器 {0} 未被接受，没有固化任何内容；请检查产品的供电和写保护，再检查惯组配置中的这个寄存器</translation>
    </message>
    <message>
        <source>IMU: register {0} ({1}) reads back {2} instead of {3} {4}; look at the unit&apos;s supply and write protection, then check type, orders and tolerance of this register in the IMU profile</source>
        <translation>惯组：{4}寄存器 {0}（{1}）回读为 {2}，应为 {3}；请检查产品的供电和写保护，再检查惯组配置中这个寄存器的 type、字节顺序、字顺序和 tolerance</translation>
    </message>
    <message>
        <source>IMU: reading {0} failed ({1}); start again, and send this text to whoever looks after calstation where it comes back</source>
        <translation>惯组：读取 {0} 失败（{1}）；请重新开始，若再次出现，请把这段文字发给 calstation 的维护人员</translation>
    </message>
    <message>
        <source>IMU: the unit&apos;s accelerometer matrix is not lower triangular, so it is not from this program and cannot be calibrated upon; restore the unit&apos;s factory settings first</source>
        <translation>惯组：产品的加表矩阵不是下三角阵，不是本程序写入的，不能在它的基础上标定；请先恢复产品的出厂设置</translation>
    </message>
    <message>
        <source>IMU: identity &apos;{0}&apos; is not &apos;model;serial;firmware&apos;; choose another profile</source>
        <translation>惯组：标识“{0}”不是“model;serial;firmware”的形式；请另选惯组配置</translation>
    </message>
    <message>
        <source>IMU: the {0} was not done within {1} s; leave its power on until it is, then start again</source>
        <translation>惯组：{0}在 {1} s 内没有完成；请保持通电直到完成，再重新开始</translation>
    </message>
    <message>
        <source>IMU: the unit&apos;s flash is still busy {0} s after its commit; leave its power on until it is done, then start again</source>
        <translation>惯组：固化开始 {0} s 后闪存仍忙；请保持通电直到完成，再重新开始</translation>
    </message>
    <message>
        <source>IMU: {0} takes no value, so a restart could not be told; look at the unit&apos;s write protection</source>
        <translation>惯组：{0} 写不进数值，无法判断产品是否重启；请检查产品的写保护</translation>
    </message>
    <message>
        <source>IMU: the unit answers but has not restarted within {0} s of its reset, so what its flash holds is not known; switch its power off and on, then start again</source>
        <translation>惯组：产品有应答，但复位后 {0} s 内没有重启，闪存中的内容不明；请断电再上电，然后重新开始</translation>
    </message>
    <message>
        <source>virtual bench: its process has ended; start the run again</source>
        <translation>虚拟台：它的进程已经结束；请重新开始</translation>
    </message>
    <message>
        <source>virtual bench: lost ({0}); start the run again</source>
        <translation>虚拟台：连接中断（{0}）；请重新开始</translation>
    </message>
    <message>
        <source>{0}: was carried on in {1} and has reached its end there; start a new run</source>
        <translation>{0}：已在 {1} 中继续并做完；请重新开始标定</translation>
    </message>
    <message>
        <source>transfer {0} to unit &apos;{1}&apos;: the registers of IMU profile &apos;{2}&apos; mean something else now than then; bring the profile&apos;s earlier version back (page Station)</source>
        <translation>产品 {1} 的写入 {0}：惯组配置“{2}”的寄存器含义与当时不同；请在“工位”页恢复该配置的旧版本</translation>
    </message>
    <message>
        <source>IMU: transfer {0} was to a &apos;{1}&apos; of serial number &apos;{2}&apos;, but a &apos;{3}&apos; answers; put that unit into the fixture</source>
        <translation>惯组：写入 {0} 的对象是编号 {2} 的“{1}”，现在应答的是“{3}”；请把原来那台产品装入夹具</translation>
    </message>
    <message>
        <source>the result is of a unit with IMU profile &apos;{0}&apos;, product &apos;{1}&apos; has &apos;{2}&apos;; choose the result&apos;s own product, &apos;{3}&apos;</source>
        <translation>该结果属于惯组配置“{0}”的产品，而当前产品类型“{1}”用的是“{2}”；请选择该结果自己的产品类型“{3}”</translation>
    </message>
    <message>
        <source>serial number &apos;{0}&apos; does not fit the product&apos;s pattern &apos;{1}&apos;; choose the product that belongs to the unit</source>
        <translation>编号“{0}”不符合产品的规则“{1}”；请选择与产品对应的型号</translation>
    </message>
    <message>
        <source>gravity</source>
        <extracomment>Names of a proof&apos;s comparisons (`station.proof`), in words.</extracomment>
        <translation>重力</translation>
    </message>
    <message>
        <source>the earth&apos;s rate</source>
        <translation>地球自转角速度</translation>
    </message>
    <message>
        <source>the earth&apos;s rate about the vertical</source>
        <translation>地球自转的垂直分量</translation>
    </message>
    <message>
        <source>the turn of the outer axis</source>
        <translation>外轴转角</translation>
    </message>
    <message>
        <source>the turn of the inner axis</source>
        <translation>内轴转角</translation>
    </message>
    <message>
        <source>gravity carried along by the gyros</source>
        <translation>陀螺递推的重力方向</translation>
    </message>
    <message>
        <source>the force at rest is off by</source>
        <translation>静止比力偏差</translation>
    </message>
    <message>
        <source>the rate at rest is off by</source>
        <translation>静止角速率偏差</translation>
    </message>
    <message>
        <source>a turn is off by</source>
        <translation>转角偏差</translation>
    </message>
    <message>
        <source>The safety circuit (interlock) was opened; close the cover, then press “Reset the fault”</source>
        <extracomment>Sentences that a window says otherwise than a terminal: in plainer words, or with a mend that is a button.</extracomment>
        <translation>安全联锁被断开；请关好防护罩，然后按“复位故障”</translation>
    </message>
    <message>
        <source>The table&apos;s watchdog stopped it, the computer had fallen silent; press “Reset the fault”</source>
        <translation>计算机一度没有响应，转台的看门狗把它停住了；请按“复位故障”</translation>
    </message>
    <message>
        <source>An axis ran into its limit; see what drove it there, then press “Reset the fault”</source>
        <translation>有一个轴碰到了限位；请查清原因，然后按“复位故障”</translation>
    </message>
    <message>
        <source>The drive reports a fault; read its display, remove the cause, then press “Reset the fault”</source>
        <translation>驱动器报告故障；请查看驱动器面板，排除原因，然后按“复位故障”</translation>
    </message>
    <message>
        <source>An axis is blocked or overloaded; free it, then press “Reset the fault”</source>
        <translation>有一个轴被卡住或过载；请排除阻碍，然后按“复位故障”</translation>
    </message>
    <message>
        <source>The table has latched the fault “{0}”; remove its cause, then press “Reset the fault”</source>
        <translation>转台锁存了故障“{0}”；请排除原因，然后按“复位故障”</translation>
    </message>
    <message>
        <source>Its process ended unexpectedly{0}; the table&apos;s watchdog, where it has one, stops it and stays latched: look at the table, press “Reset the fault”, then start again or resume the run at its last finished stage</source>
        <translation>程序进程意外结束{0}；转台若有看门狗，会自行停转并锁存故障：请查看转台，按“复位故障”，再重新开始，或从最后完成的阶段之后继续</translation>
    </message>
    <message>
        <source>It gives no sign of life any more; the table&apos;s watchdog, where it has one, stops it and stays latched: look at the table; its fault is to be reset before you start again or resume the run at its last finished stage</source>
        <translation>程序没有任何响应；转台若有看门狗，会自行停转并锁存故障：请查看转台；先复位其故障，再重新开始，或从最后完成的阶段之后继续</translation>
    </message>
    <message>
        <source>The table has latched a fault and does not tell its cause; read its display, look at cover, limits and drives, remove the cause, then press “Reset the fault”</source>
        <translation>转台锁存了故障，但没有说明原因；请查看转台的显示，检查防护罩、限位和驱动器，排除原因后按“复位故障”</translation>
    </message>
    <message>
        <source>Writing the registers of {0} was interrupted; press Understood, then finish it or take it back</source>
        <translation>向 {0} 写寄存器时中断；请按“知道了”，然后选择写完或恢复</translation>
    </message>
    <message>
        <source>Registers of {0} were written by IMU profile “{1}” (product “{2}”), this product has “{3}”; choose a product with that profile</source>
        <translation>产品 {0} 的寄存器是按惯组配置“{1}”（产品类型“{2}”）写入的，当前产品类型用的是“{3}”；请选择使用该配置的产品类型</translation>
    </message>
    <message>
        <source>Registers of {0} were written for other parameters than those of IMU profile “{1}”; choose the product of that unit</source>
        <translation>产品 {0} 的寄存器所含参数与惯组配置“{1}”的不同；请选择该产品所属的产品类型</translation>
    </message>
    <message>
        <source>{0} is in use by another calstation, process {1} of {2}, since {3}; wait for its end, or end it there</source>
        <translation>{0} 正被另一个 calstation 占用（用户 {2} 的进程 {1}，自 {3} 起）；请等它结束，或到那里结束它</translation>
    </message>
    <message>
        <source>Line {1} of {0} is damaged, so it is not known what was written to {2}; compare the unit&apos;s registers with those of its last result (Engineer page), then move this file away</source>
        <translation>{0} 第 {1} 行已损坏，无法确知向 {2} 写过什么；请将产品寄存器与其最近一次结果核对（工程师页），然后移走该文件</translation>
    </message>
    <message>
        <source>The flash of {0} has been written {1} times, the IMU profile “{3}” allows {2}; take the unit out of service, or correct flash_cycles_max in the profile where its data sheet allows more</source>
        <translation>{0} 的闪存已写 {1} 次，IMU 配置文件“{3}”只允许 {2} 次；请停用该产品，若数据手册允许更多，则更正配置文件中的 flash_cycles_max</translation>
    </message>
    <message>
        <source>The run of {0} is still going; stop it first</source>
        <translation>{0} 的标定仍在进行；请先停止它</translation>
    </message>
    <message>
        <source>The run began on station “{0}”, this is “{1}”; choose the station that it began on, then carry it on</source>
        <translation>该次标定是在工位“{0}”开始的，当前是“{1}”；请选择原来的工位，再继续</translation>
    </message>
    <message>
        <source>Nobody has confirmed at this computer that the station stands at {0}°, {1}°, {2} m, and gyros of this grade cannot tell; an engineer makes sure and confirms it on the page Station, in the section Site</source>
        <translation>尚无人在本机确认工位就在 {0}°、{1}°、{2} m 处，而这一等级的陀螺无法判断；请工程师核实后在“工位”页的“站址”一栏中确认</translation>
    </message>
    <message>
        <source>Confirmed was “{0}”, not that the station stands at {1}°, {2}°, {3} m, at this computer; an engineer makes sure and confirms it on the page Station, in the section Site</source>
        <translation>已确认的是“{0}”，而不是在本机确认工位在 {1}°、{2}°、{3} m 处；请工程师核实后在“工位”页的“站址”一栏中确认</translation>
    </message>
    <message>
        <source>The run began on a virtual bench and station “{0}” is hardware now, or the other way round; start a new run</source>
        <translation>该次标定开始时与工位“{0}”现在的类型不同（一个是虚拟台，一个是实物）；请重新开始标定</translation>
    </message>
    <message>
        <source>The unit was restarted and holds its old registers.</source>
        <extracomment>What may stand behind a sentence: what the unit holds after it, or another way.</extracomment>
        <translation>产品已重启，寄存器仍为旧值。</translation>
    </message>
    <message>
        <source>The unit holds its new registers, not yet proved: press Understood, then finish or take them back.</source>
        <translation>产品的寄存器已是新值，尚未验证：请按“知道了”，然后选择写完或恢复。</translation>
    </message>
    <message>
        <source>The unit holds neither its old nor its new registers: press Understood, then finish or take them back.</source>
        <translation>产品的寄存器既不是旧值也不是新值：请按“知道了”，然后选择写完或恢复。</translation>
    </message>
    <message>
        <source>What the unit&apos;s flash holds will be seen at the next start.</source>
        <translation>产品闪存中的内容将在下次启动时查明。</translation>
    </message>
    <message>
        <source>Or choose “Write, table at rest”.</source>
        <translation>或者选择“写入，转台不动”。</translation>
    </message>
    <message>
        <source>The program made a mistake: {0}</source>
        <translation>程序出错：{0}</translation>
    </message>
    <message>
        <source>Start the run again; if it comes back, send the log and this text to whoever looks after calstation.</source>
        <translation>请重新开始；如果再次出现，请把记录文件和这段文字交给负责 calstation 的人。</translation>
    </message>
    <message>
        <source>table: does not settle at outer {0}°, inner {1}°; look at the drive&apos;s tuning and for what shakes the table</source>
        <translation>转台：在外轴 {0}°、内轴 {1}° 处稳不下来；请检查驱动器整定以及是什么在晃动转台</translation>
    </message>
    <message>
        <source>table: it is under local control; switch it to remote control, then start again</source>
        <translation>转台：处于本地控制；请切换到远程控制，然后重新开始</translation>
    </message>
    <message>
        <source>table: it was switched to local control; switch it back, then start again</source>
        <translation>转台：被切换到本地控制；请切换回远程控制，然后重新开始</translation>
    </message>
    <message>
        <source>IMU: no data any more though it was told to stream; switch it off and on, then check cable, power and port</source>
        <translation>惯组：已令其输出，仍无数据；请给产品断电重启，再检查电缆、电源和端口</translation>
    </message>
    <message>
        <source>table: stands {0}° away from outer {1}°, inner {2}°; look for an obstacle, at encoder and drive, then home the table</source>
        <translation>转台：与外轴 {1}°、内轴 {2}° 相差 {0}°；请检查有无障碍物、编码器和驱动器，再重新回零</translation>
    </message>
    <message>
        <source>table: port {0} was lost ({1}); check cable and power</source>
        <translation>转台：端口 {0} 断开（{1}）；请检查电缆和电源</translation>
    </message>
    <message>
        <source>table: &apos;{0}&apos; is not answered on {1} within {2} s; check cable, power, baud and the table profile</source>
        <translation>转台：{1} 上的命令 {0} 在 {2} s 内没有应答；请检查电缆、电源、波特率和转台配置</translation>
    </message>
    <message>
        <source>table: port {0}: no USB adapter with this serial number is plugged in; plug it in, or correct the port in the station file; adapters found: {1}</source>
        <translation>转台：端口 {0}：没有插着这个序列号的 USB 转接器；请插上，或改正工位文件中的端口；现有转接器：{1}</translation>
    </message>
    <message>
        <source>IMU: port {0}: no USB adapter with this serial number is plugged in; plug it in, or correct the port in the station file; adapters found: {1}</source>
        <translation>惯组：端口 {0}：没有插着这个序列号的 USB 转接器；请插上，或改正工位文件中的端口；现有转接器：{1}</translation>
    </message>
    <message>
        <source>IMU: port {0} was lost ({1}); check cable and power</source>
        <translation>惯组：端口 {0} 断开（{1}）；请检查电缆和电源</translation>
    </message>
    <message>
        <source>IMU: the output is no number again and again; switch the unit off and on, check the IMU profile</source>
        <translation>惯组：反复输出非数值；请给产品断电重启，并检查惯组配置</translation>
    </message>
    <message>
        <source>IMU: the output is no number; switch the unit off and on, check the IMU profile</source>
        <translation>惯组：输出不是数值；请给产品断电重启，并检查惯组配置</translation>
    </message>
    <message>
        <source>IMU: the output saturates though the table rests or turns slowly; look for what shakes the unit, check the IMU profile</source>
        <translation>惯组：转台静止或慢转时输出就已饱和；请查找是什么在晃动产品，并检查惯组配置</translation>
    </message>
    <message>
        <source>IMU: samples are lost or spoilt again and again; check cable, baud and the load of this computer</source>
        <translation>惯组：反复丢数或数据无效；请检查电缆、波特率和本机负荷</translation>
    </message>
    <message>
        <source>IMU: no answer on {0} within {1} s, the bytes that come are no frames; check baud, parity and the IMU profile</source>
        <translation>惯组：{0} 在 {1} s 内没有应答，收到的字节不成帧；请检查波特率、校验位和惯组配置</translation>
    </message>
    <message>
        <source>IMU: no answer on {0} within {1} s though samples come; check the transmit line and the IMU profile</source>
        <translation>惯组：有数据，但 {0} 在 {1} s 内没有应答；请检查发送线和惯组配置</translation>
    </message>
    <message>
        <source>IMU: with its new registers {0} measures {1}, expected {2} within {3}; its old registers were put back; look whether the table was disturbed, whether latitude and gravity in the station file are right, and whether the IMU profile&apos;s registers mean what the unit makes of them; then run again</source>
        <translation>惯组：写入新寄存器后 {0} 实测 {1}，应为 {2}，允差 {3}，旧寄存器已恢复；请检查转台是否受扰、工位文件中的纬度和重力是否正确、惯组配置中寄存器的含义是否与产品一致，然后重新标定</translation>
    </message>
    <message>
        <source>{0}: its disk is nearly full, less than {1} MB are left; make room on it, then resume the run</source>
        <translation>{0}：所在磁盘将满，剩余不足 {1} MB；请腾出空间，再继续本次标定</translation>
    </message>
    <message>
        <source>{0}: the log cannot be written any more ({1}); make room on its disk, or bring its folder back, then resume the run</source>
        <translation>{0}：无法继续写入（{1}）；请腾出磁盘空间或恢复其文件夹，再继续本次标定</translation>
    </message>
    <message>
        <source>{0} (Modbus exception {1})</source>
        <translation>{0}（Modbus 异常 {1}）</translation>
    </message>
    <message>
        <source>{0} of unit {1}</source>
        <translation>{0}，从站 {1}</translation>
    </message>
    <message>
        <source>page {0} register {1}</source>
        <translation>第 {0} 页寄存器 {1}</translation>
    </message>
    <message>
        <source>register {0}</source>
        <translation>寄存器 {0}</translation>
    </message>
    <message>
        <source>commit</source>
        <translation>固化</translation>
    </message>
    <message>
        <source>reset</source>
        <translation>复位</translation>
    </message>
    <message>
        <source>before the commit</source>
        <translation>固化前</translation>
    </message>
    <message>
        <source>after the restart</source>
        <translation>重启后</translation>
    </message>
    <message>
        <source>code {0}</source>
        <translation>代码 {0}</translation>
    </message>
    <message>
        <source>exception {0}</source>
        <translation>异常 {0}</translation>
    </message>
    <message>
        <source>no answer</source>
        <translation>没有应答</translation>
    </message>
    <message>
        <source>what is answered is another request</source>
        <translation>应答的是另一个请求</translation>
    </message>
    <message>
        <source>an answer of the wrong length</source>
        <translation>应答长度不对</translation>
    </message>
    <message>
        <source>the answer has another length</source>
        <translation>应答的长度不符</translation>
    </message>
    <message>
        <source>the link is gone</source>
        <translation>链路已断开</translation>
    </message>
    <message>
        <source>the port was lost: {0}</source>
        <translation>端口丢失：{0}</translation>
    </message>
    <message>
        <source>cause not told</source>
        <translation>原因未说明</translation>
    </message>
    <message>
        <source>quick stop</source>
        <translation>快速停止</translation>
    </message>
    <message>
        <source>the function is not supported</source>
        <translation>不支持该功能码</translation>
    </message>
    <message>
        <source>no such register</source>
        <translation>没有这个寄存器</translation>
    </message>
    <message>
        <source>the value is refused</source>
        <translation>数值被拒绝</translation>
    </message>
    <message>
        <source>the device cannot do it in its present state</source>
        <translation>设备在当前状态下无法执行</translation>
    </message>
    <message>
        <source>acknowledged, not done yet</source>
        <translation>已接受，尚未完成</translation>
    </message>
    <message>
        <source>the device is busy</source>
        <translation>设备忙</translation>
    </message>
    <message>
        <source>memory parity error</source>
        <translation>存储器奇偶校验错误</translation>
    </message>
    <message>
        <source>gateway path unavailable</source>
        <translation>网关路径不可用</translation>
    </message>
    <message>
        <source>no answer behind the gateway</source>
        <translation>网关后面没有应答</translation>
    </message>
    <message>
        <source>check the table profile&apos;s registers</source>
        <translation>请检查转台配置中的寄存器</translation>
    </message>
    <message>
        <source>wait until it is done, then start again</source>
        <translation>请等它完成后重新开始</translation>
    </message>
    <message>
        <source>check the gateway and the unit number</source>
        <translation>请检查网关和站号</translation>
    </message>
    <message>
        <source>look at the drive&apos;s display</source>
        <translation>请查看驱动器的显示</translation>
    </message>
    <message>
        <source>compare op read_words of the IMU profile with the unit&apos;s manual</source>
        <translation>请对照产品手册核对惯组配置中的 read_words</translation>
    </message>
    <message>
        <source>compare [modbus] of the IMU profile with the unit&apos;s manual</source>
        <translation>请对照产品手册核对惯组配置中的 [modbus]</translation>
    </message>
    <message>
        <source>look at its supply (a unit that restarts forgets its page), then check the registers in the IMU profile</source>
        <translation>请检查供电（产品重启后会丢失所选的页），再检查惯组配置中的寄存器</translation>
    </message>
    <message>
        <source>switch the unit off and on, then start again</source>
        <translation>请把产品断电再上电，然后重新开始</translation>
    </message>
    <message>
        <source>switch the unit off and on, replace it where that does not help</source>
        <translation>请把产品断电再上电，仍不行则更换产品</translation>
    </message>
    <message>
        <source>check the gateway and modbus.unit of the IMU profile</source>
        <translation>请检查网关和惯组配置中的 modbus.unit</translation>
    </message>
    <message>
        <source>look this exception up in the unit&apos;s manual</source>
        <translation>请在产品手册中查这个异常码</translation>
    </message>
    <message>
        <source>unknown command</source>
        <translation>未知命令</translation>
    </message>
    <message>
        <source>flash busy</source>
        <translation>闪存忙</translation>
    </message>
    <message>
        <source>it cannot do it in its present state</source>
        <translation>当前状态下无法执行</translation>
    </message>
    <message>
        <source>compare [commands] of the IMU profile with the unit&apos;s manual</source>
        <translation>请对照产品手册核对惯组配置中的 [commands]</translation>
    </message>
    <message>
        <source>check the addresses of the registers in the IMU profile</source>
        <translation>请检查惯组配置中寄存器的地址</translation>
    </message>
    <message>
        <source>check type, scale and range of the registers in the IMU profile</source>
        <translation>请检查惯组配置中寄存器的 type、scale 和 range</translation>
    </message>
    <message>
        <source>look this error up in the unit&apos;s manual</source>
        <translation>请在产品手册中查这个错误码</translation>
    </message>
    <message>
        <source>hard fault, the unit restarts</source>
        <translation>硬件错误，产品将重启</translation>
    </message>
    <message>
        <source>serial buffer overflow</source>
        <translation>串口缓冲区溢出</translation>
    </message>
    <message>
        <source>invalid checksum</source>
        <translation>校验错误</translation>
    </message>
    <message>
        <source>invalid command</source>
        <translation>无效命令</translation>
    </message>
    <message>
        <source>not enough parameters</source>
        <translation>参数不足</translation>
    </message>
    <message>
        <source>too many parameters</source>
        <translation>参数过多</translation>
    </message>
    <message>
        <source>invalid parameter</source>
        <translation>无效参数</translation>
    </message>
    <message>
        <source>invalid register</source>
        <translation>无效寄存器</translation>
    </message>
    <message>
        <source>unauthorized access</source>
        <translation>无权访问</translation>
    </message>
    <message>
        <source>watchdog reset</source>
        <translation>看门狗复位</translation>
    </message>
    <message>
        <source>output buffer overflow</source>
        <translation>输出缓冲区溢出</translation>
    </message>
    <message>
        <source>insufficient baud rate</source>
        <translation>波特率不足</translation>
    </message>
    <message>
        <source>error buffer overflow</source>
        <translation>错误缓冲区溢出</translation>
    </message>
    <message>
        <source>look at its supply, switch it off and on; replace it where that does not help</source>
        <translation>请检查供电，断电再上电，仍不行则更换产品</translation>
    </message>
    <message>
        <source>raise its baud, or have it send less</source>
        <translation>请提高波特率，或减少产品发送的内容</translation>
    </message>
    <message>
        <source>check the cable, and vectornav.check of the IMU profile</source>
        <translation>请检查电缆和惯组配置中的 vectornav.check</translation>
    </message>
    <message>
        <source>compare this line with the unit&apos;s manual, and correct the IMU profile</source>
        <translation>请对照产品手册核对这一行，并改正惯组配置</translation>
    </message>
    <message>
        <source>look at the unit&apos;s write protection</source>
        <translation>请检查产品的写保护</translation>
    </message>
</context>
</TS>
